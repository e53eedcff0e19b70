"""How often: fixed windows of a minute for each caller, told by the RateLimit headers (draft-ietf-httpapi)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from starlette.types import Scope

from wonderland.problems import said
from wonderland_backend.answer_headers import add_headers
from wonderland_backend.errors import TooManyRequests

WINDOW_MS: Final = 60_000
MAX_CALLERS: Final = 10_000


@dataclass(slots=True)
class _Window:
    began_ms: int
    count: int


@dataclass(frozen=True, slots=True)
class Allowance:
    """What is left to a caller in the present window."""

    quota: int
    remaining: int
    reset_s: int
    exceeded: bool

    def headers(self) -> dict[str, str]:
        """``RateLimit-Policy`` and ``RateLimit``."""
        return {
            "RateLimit-Policy": f'"default";q={self.quota};w={WINDOW_MS // 1000}',
            "RateLimit": f'"default";r={self.remaining};t={self.reset_s}',
        }


class RateLimits:
    """Counts the requests of each caller, in this process."""

    def __init__(self, per_minute: int, clock: Callable[[], int]) -> None:
        self._quota = per_minute
        self._clock = clock
        self._windows: dict[str, _Window] = {}

    def count(self, caller: str, quota: int | None = None) -> Allowance:
        """Count one request; `quota` a minute in place of the usual one."""
        now = self._clock()
        window = self._windows.get(caller)
        if window is None or now - window.began_ms >= WINDOW_MS or now < window.began_ms:
            if len(self._windows) >= MAX_CALLERS:
                self._forget(now)
            window = self._windows[caller] = _Window(now, 0)
        window.count += 1
        quota = quota or self._quota
        reset_s = max(1, -(-(window.began_ms + WINDOW_MS - now) // 1000))
        return Allowance(quota, max(0, quota - window.count), reset_s, window.count > quota)

    def admit(self, scope: Scope, caller: str, quota: int | None = None) -> None:
        """Count a request, and have its answer say what is left. Raises `TooManyRequests`."""
        allowance = self.count(caller, quota)
        add_headers(scope, allowance.headers())
        if allowance.exceeded:
            raise TooManyRequests(
                said("too_many_requests", quota=allowance.quota, wait_s=allowance.reset_s),
                headers={"Retry-After": str(allowance.reset_s)},
            )

    def _forget(self, now: int) -> None:
        over = [caller for caller, window in self._windows.items() if now - window.began_ms >= WINDOW_MS]
        # None over: somebody makes up callers. The counts of all begin anew rather than memory filling up.
        for caller in over or list(self._windows):
            del self._windows[caller]
