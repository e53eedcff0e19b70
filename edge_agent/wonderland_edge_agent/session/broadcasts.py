"""What the pad heard on Remote ID in one session: taken in as it comes, so that no flood can wash out what matters.

A record holds 200 messages; whoever broadcasts a drone's serial number can send a thousand a second. Kept are those
that lie nearest to the drone's signed path for what they can mean, and the newest; the record then has first what the
drone attested, one message of each, then the nearest, then the newest. A flood of messages that are nearer still than
the drone's own can only be one of messages that support it.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from wonderland.proofs.attestation import digest_of
from wonderland.proofs.broadcast import SAME_TIME_MS, place_said
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.drone_clock import drone_clock, on_the_pads_clock
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.records.pads import Frame
from wonderland.proofs.records.sessions import MAX_CLAIMS, BroadcastClaim, Claim, ClockReading, Session

Broadcasts = Callable[[int], tuple[BroadcastClaim, ...]]
"""What the receiver heard of this drone since a time (ms), in order of time."""
EVERY_MS: Final = 100
"""How often the receiver is asked: it remembers more than a flood of that long."""
KEPT: Final = 400
"""Of the nearest, and of the newest; twice what a record holds, for they may be the same."""
NEAREST: Final = 100
"""Of the record: the rest is for what was attested and for the newest."""


class HeardBroadcasts:
    """Bounded, whatever is heard. ``said()``: the drone's claims and the readings of its clock so far.

    ``unsure``: messages of transmitters that named several drones, this one among them. Only those count that the drone
    attested: else whoever sends under its transmitter's address could have its messages given to nobody.
    """

    def __init__(
        self,
        session: Session,
        frame: Frame,
        heard: Broadcasts,
        unsure: Broadcasts,
        said: Callable[[], tuple[Sequence[Claim], Sequence[ClockReading]]],
    ) -> None:
        self._session = session
        self._frame = frame
        self._heard = heard
        self._unsure = unsure
        self._since_ms = 0
        self._said = said
        self._asked_ms: int | None = None
        self._edge: set[BroadcastClaim] = set()
        """Messages of the last moment that was asked for: more may have come in it."""
        self._order = 0
        self._nearest: list[tuple[float, int, BroadcastClaim]] = []
        """A heap with the farthest first."""
        self._newest: deque[BroadcastClaim] = deque(maxlen=KEPT)

    def listen(self, since_ms: int, now_ms: int, *, whole: bool = False) -> None:
        """Take in what was heard since the last time; ``whole``: whether or not it is time again."""
        self._since_ms = since_ms
        if self._asked_ms is not None and not whole and now_ms - self._asked_ms < EVERY_MS:
            return
        fresh = [each for each in self._heard(since_ms if not self._edge else self._last_ms) if each not in self._edge]
        self._asked_ms = now_ms
        if not fresh:
            return
        last_ms = fresh[-1].t_ms
        self._edge = {each for each in (*self._edge, *fresh) if each.t_ms == last_ms}
        beyond = self._beyond()
        for message in fresh:
            self._order += 1
            self._newest.append(message)
            heapq.heappush(self._nearest, (-beyond(message), self._order, message))
            if len(self._nearest) > KEPT:
                heapq.heappop(self._nearest)

    def chosen(self, attested: Iterable[str]) -> tuple[BroadcastClaim, ...]:
        """What the record holds, in order of time."""
        beyond = self._beyond()
        near = sorted({message for *_, message in self._nearest}, key=lambda each: (beyond(each), each.t_ms))
        newest = list(reversed(self._newest))
        digests = dict.fromkeys(attested)
        own: dict[str, BroadcastClaim] = {}
        unsure = self._unsure(self._since_ms) if digests else ()
        for message in sorted({*near, *newest, *unsure}, key=lambda each: each.t_ms):
            digest = digest_of(message)
            if digest is not None and digest in digests:
                own.setdefault(digest, message)
        chosen = dict.fromkeys((*own.values(), *near[:NEAREST], *newest, *near))
        return tuple(sorted(list(chosen)[:MAX_CLAIMS], key=lambda each: each.t_ms))

    @property
    def _last_ms(self) -> int:
        return next(iter(self._edge)).t_ms

    def _beyond(self) -> Callable[[BroadcastClaim], float]:
        """How far (mm) beyond what it can mean each message is from the signed path, as far as that is known."""
        claims, readings = self._said()
        session, frame = self._session, self._frame
        try:
            path = ClaimedPath(frame, on_the_pads_clock((session.claim, *claims), drone_clock(readings)))
        except GeometryError:
            return lambda _message: 0.0

        def beyond(message: BroadcastClaim) -> float:
            said = place_said(session, frame, message, path, message.t_ms)
            # Away from the claims everything can mean anything: there the mere distance counts.
            return said.beyond() if said.gap_ms <= SAME_TIME_MS else said.beyond() + said.tolerance

        return beyond
