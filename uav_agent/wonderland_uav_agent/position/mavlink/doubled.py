"""Whether two use one name: each sender numbers its messages, and numbers of two do not follow each other."""

from __future__ import annotations

from collections import deque
from typing import Final

STEPS, WITHIN_MS = 3, 5_000
"""So many steps back within this time are no restart and no burst of losses."""


class Doubled:
    """Of one name on one link."""

    def __init__(self) -> None:
        self._steps: Final[deque[int]] = deque(maxlen=STEPS)

    def step_back(self, now_ms: int) -> bool:
        """A number that went back; whether this one tells that there are two."""
        before = self.now(now_ms)
        self._steps.append(now_ms)
        return self.now(now_ms) and not before

    def now(self, now_ms: int) -> bool:
        """Whether two speak."""
        return len(self._steps) == STEPS and now_ms - self._steps[0] <= WITHIN_MS
