"""The board of the backend on duty as another one has it: a snapshot, then what each frame changes.

It forgets as the board itself does, and where that depends on its clock (sessions) it is told.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from typing import Any, Final

import orjson

from wonderland_backend.alerts import store as alerts
from wonderland_backend.live.aside import Aside
from wonderland_backend.live.board import TRACK_AGE_MS
from wonderland_backend.live.queries import LAST_VERDICTS, MAX_TRACKS

_KEYS: Final = {
    "pads": "pad_id",
    "tracks": "uav_id",
    "estimates": "uav_id",
    "sessions": "session_id",
    "alerts": "alert_id",
}


class BoardCopy:
    """What another backend's board shows. `stale_since_ms`: since when nothing was heard of it; None while it is."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self.viewers: Callable[[], int] = lambda: 0
        self.stale_since_ms: int | None = None
        self._status: dict[str, Any] = {}
        self._clear()

    def _clear(self) -> None:
        self._items: dict[str, OrderedDict[str, dict[str, Any]]] = {kind: OrderedDict() for kind in _KEYS}
        self._verdicts: deque[dict[str, Any]] = deque(maxlen=LAST_VERDICTS)
        self._pad_owners: dict[str, str] = {}
        self._drone_owners: dict[str, str] = {}
        self.has_more_alerts = False

    def replace(self, parts: Iterable[str | bytes], owners: Aside) -> None:
        """Show this snapshot, and nothing else."""
        self._clear()
        for part in parts:
            frame = orjson.loads(part)
            self.has_more_alerts |= frame.get("alerts_more", False)
            self._take(frame)
        self._note(owners)

    def apply(self, frame: dict[str, Any], aside: Aside) -> None:
        """What a frame changes."""
        self._note(aside)
        self._take(frame)
        for session_id in aside.gone:
            if (session := self._items["sessions"].pop(session_id, None)) is not None:
                self._end_estimate(session)

    def snapshot(self) -> dict[str, list[Any]]:
        """As `Board.snapshot`."""
        oldest = self._clock() - TRACK_AGE_MS
        items = {kind: list(found.values()) for kind, found in self._items.items()}
        return {
            "pads": [self._items["pads"][pad_id] for pad_id in sorted(self._items["pads"])],
            "sessions": items["sessions"],
            "verdicts": list(self._verdicts),
            "alerts": items["alerts"],
            "tracks": [track for track in items["tracks"] if track["t_ms"] >= oldest],
            "estimates": items["estimates"],
        }

    def status(self) -> dict[str, Any]:
        """The Status of the backend on duty, and since when nothing was heard of it."""
        server = self._status.get("server", {}) | {"stale_since_ms": self.stale_since_ms}
        return self._status | {"server": server}

    def pad_owner(self, pad_id: str) -> str | None:
        """Whose pad it is on the ledger."""
        return self._pad_owners.get(pad_id)

    def drone_owner(self, uav_id: str) -> str | None:
        """Whose drone it is on the ledger."""
        return self._drone_owners.get(uav_id)

    def is_connected(self, pad_id: str) -> bool:
        """Whether this pad's agent is connected with the backend on duty."""
        health = self._items["pads"].get(pad_id, {}).get("health")
        return health is not None and bool(health["connected"])

    def _note(self, aside: Aside) -> None:
        self._pad_owners |= aside.pads
        self._drone_owners |= aside.drones

    def _take(self, frame: dict[str, Any]) -> None:
        for kind, key in _KEYS.items():
            items = self._items[kind]
            for item in frame.get(kind, ()):
                items[item[key]] = item
                if kind == "tracks":
                    items.move_to_end(item[key])
                elif kind == "sessions" and item["state"] != "requested":
                    self._end_estimate(item)
                elif kind == "alerts" and item["state"] not in alerts.WAITING:
                    del items[item[key]]
        for kind in ("tracks", "estimates"):
            _limit(self._items[kind], MAX_TRACKS)
        self.has_more_alerts |= _limit(self._items["alerts"], alerts.MAX_OPEN)
        self._verdicts.extend(frame.get("verdicts", ()))
        self._status = frame.get("status", self._status)

    def _end_estimate(self, session: dict[str, Any]) -> None:
        known = self._items["estimates"].get(session["uav_id"])
        if known is not None and known["session_id"] == session["session_id"]:
            del self._items["estimates"][session["uav_id"]]


def _limit(items: OrderedDict[str, Any], most: int) -> bool:
    """Whether some had to go, the oldest first."""
    too_many = len(items) > most
    while len(items) > most:
        items.popitem(last=False)
    return too_many
