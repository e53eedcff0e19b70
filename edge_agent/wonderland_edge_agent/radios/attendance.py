"""Which anchors range, and which answer their commands and never do: from sessions, and from roll calls between them.

A drone out of reach makes all anchors silent, and then none of them is at fault. One that measures nothing while others
do is. Pure; time is handed in.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from wonderland_fira_uci.uci.status import Status, status_name

if TYPE_CHECKING:
    from wonderland_edge_agent.radios.between import RollCall

SILENT_MS: Final = 1_000
"""An anchor without a range for so long is silent."""
ENOUGH: Final = 10
"""So many ranges of another anchor make one without any suspect."""
OTHER_KEY_MS: Final = 2_000
"""Frames whose sequence fits nobody's key, for so long and with no range among them: it is no disturbance."""
_OTHER_KEY: Final = "hears frames that are scrambled with another key"


@dataclass(slots=True)
class _Here:
    """One anchor in the session that is open."""

    ranged_ms: int
    """When it last ranged, or the session began."""
    ranges: int = 0
    status: int = Status.OK
    """Of its last measurement."""
    failing_ms: int | None = None
    """Since when every measurement has failed with another key's frames."""


class Attendance:
    """Fed with what anchors measure; says which of them have not ranged, and why."""

    def __init__(self) -> None:
        self._here: dict[str, _Here] = {}
        self._pace = 1.0
        self._faults: dict[str, str] = {}
        self._elsewhere: set[str] = set()
        """At fault in a way that a roll call, which has a key and a plan of its own, cannot see."""
        self._hidden: set[str] = set()
        """No other anchor hears these, and they range drones all the same."""
        self._shown: set[str] = set()
        """These have ranged a drone, or another anchor has ranged them."""
        self._mute: dict[str, str] = {}
        """These range and cannot speak for the pad, and why."""
        self._called = False
        """Whether a roll was called."""
        self._returned: set[str] = set()
        """Nodes that were away since the last roll call: what was known of them is of before."""

    def begin(self, anchor_ids: Iterable[str], now_ms: int, pace: float = 1.0) -> None:
        """These take part in a session from now on, whose rounds take ``pace`` times as long as usual."""
        self._pace = pace
        self._here = {anchor_id: _Here(now_ms) for anchor_id in anchor_ids}

    def measured(self, anchor_id: str, t_ms: int, *, status: int, ranged: bool) -> None:
        """An anchor's report on the drone."""
        here = self._here.get(anchor_id)
        if here is None:
            return
        here.status = status
        if ranged:
            here.ranged_ms, here.failing_ms = t_ms, None
            here.ranges += 1
            self._shown.add(anchor_id)
            self._returned.discard(anchor_id)
            if self._faults.pop(anchor_id, None) is not None and anchor_id not in self._elsewhere:
                self._hidden.add(anchor_id)
            self._elsewhere.discard(anchor_id)
        elif status != Status.RANGING_RX_PHY_STS_FAILED:
            here.failing_ms = None
        elif here.failing_ms is None:
            here.failing_ms = t_ms

    def refused(self, anchor_id: str, why: str) -> None:
        """The node is there and does not take the session."""
        self._here.pop(anchor_id, None)
        self._faults[anchor_id] = why
        self._elsewhere.add(anchor_id)

    def takes_no_words(self, anchor_id: str, why: str) -> None:
        """Its node accepts no data. It may range all the same; what cures it is a restart of the node."""
        self._mute[anchor_id] = why

    def restarted(self, anchor_id: str) -> None:
        """The node was away: whether it ranges has to be seen again, by a roll call or with a drone."""
        self._mute.pop(anchor_id, None)
        if anchor_id not in self._elsewhere:
            self._faults.pop(anchor_id, None)
        self._returned.add(anchor_id)

    def has_returned(self, anchor_id: str) -> bool:
        """Whether the node was away since the last roll call."""
        return anchor_id in self._returned

    def mute(self, anchor_id: str) -> str:
        """Why it cannot speak for the pad; empty where it can."""
        return self._mute.get(anchor_id, "")

    def end(self) -> None:
        """The session is over; what it showed is remembered."""
        if max((here.ranges for here in self._here.values()), default=0) >= ENOUGH:
            for anchor_id, here in self._here.items():
                if not here.ranges:
                    self._faults[anchor_id] = _why(here.status)
                    if here.status == Status.RANGING_RX_PHY_STS_FAILED:
                        self._elsewhere.add(anchor_id)
        self._here = {}

    def called(self, call: RollCall, *, expected: bool = False) -> dict[str, str]:
        """A roll call; what it changed, by anchor: its fault, or that it has none any more (empty).

        Anchors that all hear nobody need not be broken: they may stand so. They are where it is ``expected`` of them to
        hear each other.
        """
        before = dict(self._faults)
        self._called = self._called or bool(call.heard or call.unheard)
        self._shown |= call.heard
        self._returned -= {*call.heard, *call.unheard}
        for anchor_id in call.heard:
            self._hidden.discard(anchor_id)
            if anchor_id not in self._elsewhere:
                self._faults.pop(anchor_id, None)
        for anchor_id, why in call.unheard.items():
            if anchor_id in self._hidden or anchor_id in self._elsewhere:
                continue
            if call.heard or expected or anchor_id in call.refused:
                self._faults[anchor_id] = why
        return {
            anchor_id: self._faults.get(anchor_id, "")
            for anchor_id in (*call.heard, *call.unheard)
            if (anchor_id in before) != (anchor_id in self._faults)
        }

    def is_unproven(self, anchor_id: str) -> bool:
        """Whether it was looked for, and nothing has shown yet whether this anchor ranges."""
        return self._called and anchor_id not in self._shown and anchor_id not in self._faults

    def is_unseen(self, anchor_id: str) -> bool:
        """Whether it was not looked for yet, since the start or since its node came back, and ranged no drone."""
        new = not self._called and anchor_id not in self._shown
        return (new or anchor_id in self._returned) and anchor_id not in self._faults

    def fault(self, anchor_id: str, now_ms: int) -> str:
        """Why this anchor, which answers, would measure nothing of a drone; empty where nothing says so."""
        if self.is_silent(anchor_id, now_ms):
            others = (each for each in self._here if each != anchor_id)
            if any(not self.is_silent(other, now_ms) for other in others):
                return _why(self._here[anchor_id].status)
        return self._faults.get(anchor_id, "")

    def is_silent(self, anchor_id: str, now_ms: int) -> bool:
        """Whether a session is open and this anchor has not ranged for a while."""
        here = self._here.get(anchor_id)
        return here is not None and now_ms - here.ranged_ms > SILENT_MS * self._pace

    def is_ranging(self, anchor_id: str, now_ms: int) -> bool:
        """Whether a session is open and this anchor ranges the drone in it."""
        here = self._here.get(anchor_id)
        return here is not None and here.ranges > 0 and not self.is_silent(anchor_id, now_ms)

    def status(self, anchor_id: str) -> str:
        """What its last measurement failed with; empty where it did not."""
        here = self._here.get(anchor_id)
        return "" if here is None or here.status == Status.OK else _why(here.status)

    def other_key(self, now_ms: int) -> str:
        """Whether the drone's key must be another one: no range at all, and all who hear it hear a wrong sequence."""
        here = self._here.values()
        since = [each.failing_ms for each in here if each.failing_ms is not None]
        if not since or any(each.ranges for each in here) or now_ms - min(since) < OTHER_KEY_MS * self._pace:
            return ""
        who = ", ".join(anchor_id for anchor_id, each in self._here.items() if each.failing_ms is not None)
        return f"{who}: the drone's frames are scrambled with another key, or somebody else sends in this session"


def _why(status: int) -> str:
    if status == Status.RANGING_RX_PHY_STS_FAILED:
        return _OTHER_KEY
    return "measures nothing" + ("" if status == Status.OK else f": {status_name(status)}")
