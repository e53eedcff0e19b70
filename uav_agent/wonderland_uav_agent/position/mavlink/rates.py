"""Which messages to ask the autopilot for, and when again: ArduPilot sends little else than HEARTBEAT until asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from wonderland_uav_agent.position.mavlink.messages import (
    ATTITUDE,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    LOCAL_POSITION_NED,
    NAMES,
    SYSTEM_TIME,
    AskFor,
)

GRACE_MS: Final = 600
"""What comes often enough by itself (PX4) within this time is left as it is."""
FIRST_RETRY_MS: Final = 500
LAST_RETRY_MS: Final = 16_000
ACCEPTED, IN_PROGRESS = 0, 5


@dataclass
class _Wanted:
    interval_ms: int
    enough_ms: int
    seen_ms: int | None = None
    gap_ms: int = 0
    ask_at_ms: int = 0
    retry_ms: int = FIRST_RETRY_MS

    def comes(self, now_ms: int) -> bool:
        return self.seen_ms is not None and max(self.gap_ms, now_ms - self.seen_ms) <= self.enough_ms


class Rates:
    """Of one autopilot, from the moment at which it was found."""

    def __init__(self, system: int, now_ms: int, *, flown: bool = False, turned: bool = False) -> None:
        """``flown``: by us, too, so that its state is wanted beside its place. ``turned``: its attitude is."""
        self._system = system
        self._wanted = {
            GLOBAL_POSITION_INT: _Wanted(100, 400),
            GPS_RAW_INT: _Wanted(200, 1_000),
            SYSTEM_TIME: _Wanted(1_000, 3_000),
        }
        if flown:
            self._wanted[EXTENDED_SYS_STATE] = _Wanted(200, 1_000)
            self._wanted[LOCAL_POSITION_NED] = _Wanted(50, 150)
        if flown or turned:
            self._wanted[ATTITUDE] = _Wanted(50, 150)
        for wanted in self._wanted.values():
            wanted.ask_at_ms = now_ms + GRACE_MS
        self.refused = 0
        self.asked = 0

    def seen(self, message_id: int, now_ms: int) -> None:
        """A message came; others than the wanted ones change nothing."""
        wanted = self._wanted.get(message_id)
        if wanted is None:
            return
        wanted.gap_ms = 0 if wanted.seen_ms is None else now_ms - wanted.seen_ms
        wanted.seen_ms = now_ms
        if wanted.comes(now_ms):
            wanted.retry_ms = FIRST_RETRY_MS

    def answered(self, result: int) -> None:
        """The autopilot's word on a request; it does not say for which message."""
        self.refused += result not in {ACCEPTED, IN_PROGRESS}

    def due(self, now_ms: int) -> list[AskFor]:
        """What to ask for now: what is missing or comes too seldom, ever more rarely."""
        asked = []
        for message_id, wanted in self._wanted.items():
            if now_ms < wanted.ask_at_ms or wanted.comes(now_ms):
                continue
            wanted.ask_at_ms = now_ms + wanted.retry_ms
            wanted.retry_ms = min(2 * wanted.retry_ms, LAST_RETRY_MS)
            asked.append(AskFor(self._system, message_id, 1_000 * wanted.interval_ms))
        self.asked += len(asked)
        return asked

    def missing(self, message_id: int) -> str:
        """Why there is no such message."""
        refused = f"; the autopilot refused {self.refused} of {self.asked} requests" if self.refused else ""
        return f"no {NAMES[message_id]} from the autopilot{refused}"
