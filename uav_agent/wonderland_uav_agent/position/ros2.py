"""Positions from a topic of ROS 2 (``sensor_msgs/NavSatFix``), by the wire of rmw_zenoh; on this machine alone.

A claim says no more than the fix does: its time is that of the fix, its accuracies are worked out from the covariance,
and a fix without one is none. Whoever reaches this machine's graph can publish on the topic; two publishers at once are
heard as none.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from wonderland.clock import Clock
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.source import PositionError

if TYPE_CHECKING:
    from wonderland_rmw_zenoh.node import Arrived

_log = logging.getLogger(__name__)

FORM: Final = "ros2:/TOPIC[@tcp/127.0.0.1:PORT]"
TYPE: Final = "sensor_msgs/msg/NavSatFix"
MAX_AGE_MS: Final = 1_000
"""An older fix is no position of a flying drone."""
MAX_AHEAD_MS: Final = 500
"""So far the fix's clock may be ahead of this computer's."""
TWO_MS: Final = 5_000
"""Two publishers within this time are two at once."""
HORIZONTAL_95: Final = math.sqrt(5.991)
"""From one standard deviation of the worse direction to 95 % (χ², two degrees of freedom)."""
VERTICAL_95: Final = 1.96
BEYOND_ALL: Final = 1e9
BEYOND_ALL_M2: Final = 1e12
"""Larger numbers (and what is none) mean nothing, and would overflow."""
_UNKNOWN: Final = 0


class FixError(Exception):
    """A fix that no claim may rest on; the text says why."""


def claim_of(fix: Any, now_ms: int, after_ms: int) -> Claim:
    """A fix as a claim; ``after_ms`` is the time of the one before. Raises FixError."""
    if fix.status.status < 0:
        raise FixError("the receiver has no fix")
    t_ms = fix.header.stamp.sec * 1_000 + fix.header.stamp.nanosec // 1_000_000
    if t_ms <= after_ms:
        raise FixError("its time is not after that of the fix before")
    if t_ms > now_ms + MAX_AHEAD_MS:
        raise FixError(f"its time is {(t_ms - now_ms) / 1_000:.1f} s ahead of this computer's clock")
    if t_ms < now_ms - MAX_AGE_MS:
        raise FixError(f"it is {(now_ms - t_ms) / 1_000:.1f} s old, by its own time")
    place = (fix.latitude, fix.longitude, fix.altitude)
    if not all(abs(each) <= BEYOND_ALL for each in place):
        raise FixError("latitude, longitude or altitude is no number, or a place nowhere")
    horizontal_m, vertical_m = accuracies_m(
        fix.position_covariance_type, [float(each) for each in fix.position_covariance]
    )
    try:
        return Claim.parse(
            {
                "lat_e7": round(fix.latitude * 1e7),
                "lon_e7": round(fix.longitude * 1e7),
                "height_mm": round(fix.altitude * 1_000),
                "accuracy_mm": max(1, math.ceil(horizontal_m * 1_000)),
                "height_accuracy_mm": max(1, math.ceil(vertical_m * 1_000)),
                "t_ms": t_ms,
            }
        )
    except ProofError as error:
        raise FixError(str(error)) from error


def accuracies_m(kind: int, covariance: Sequence[float]) -> tuple[float, float]:
    """Horizontal and vertical accuracy at 95 % of a covariance (east, north, up; m²). Raises FixError."""
    if kind == _UNKNOWN:
        raise FixError("it states no covariance (position_covariance_type 0), and so no accuracy")
    east, north, up = covariance[0], covariance[4], covariance[8]
    cross = (covariance[1] + covariance[3]) / 2
    sane = all(abs(each) <= BEYOND_ALL_M2 for each in covariance)
    if not sane or min(east, north, up) <= 0 or cross**2 > east * north:
        raise FixError("its covariance is none (a variance that is not above 0, or no number)")
    worst = (east + north) / 2 + math.hypot((east - north) / 2, cross)
    return HORIZONTAL_95 * math.sqrt(worst), VERTICAL_95 * math.sqrt(up)


class Ros2Position:
    """The last fix that arrived, while it is fresh. Use as an asynchronous context manager."""

    def __init__(self, text: str, clock: Clock) -> None:
        """``text``: ``/TOPIC``, or ``/TOPIC@ADDRESS`` of a router or peer. Raises PositionError."""
        try:
            from wonderland_rmw_zenoh.interfaces import Interfaces  # noqa: PLC0415 - an extra
            from wonderland_rmw_zenoh.node import Node  # noqa: PLC0415
            from wonderland_rmw_zenoh.session import ROUTER, Link  # noqa: PLC0415
            from wonderland_rmw_zenoh.wire import is_name  # noqa: PLC0415
        except ImportError:
            raise PositionError(
                '--position ros2:…: install what it needs: pip install "wonderland-uav-agent[ros2]"'
            ) from None
        topic, _, address = text.partition("@")
        link = Link(connect=(address or ROUTER,))
        problem = link.problem() if is_name(topic) else f"{topic[:100]!r} is no topic"
        if problem:
            raise PositionError(f"--position ros2:{text}: {problem}; give {FORM}")
        self._topic = topic
        self._types = Interfaces()
        self._node = Node("/wonderland_uav", link)
        self._clock = clock
        self._last: Claim | None = None
        self._publisher = b""
        self._publisher_ms = 0
        self._two_ms = 0
        self._why = ""
        self._fresh = asyncio.Event()

    async def __aenter__(self) -> Self:
        from wonderland_rmw_zenoh.errors import Ros2Error  # noqa: PLC0415

        try:
            await self._node.__aenter__()
            self._node.subscribe(self._topic, self._take, kind=self._types.message(TYPE), max_message_bytes=4_096)
        except Ros2Error as cause:
            raise PositionError(f"--position ros2:{self._topic}: {cause}") from cause
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._node.__aexit__(kind, error, trace)

    def claim(self, now_ms: int) -> Claim | None:
        """The last fix; None when it is more than a second old, or when two publish."""
        return None if self.why_not(now_ms) else self._last

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        if self._two_ms and now_ms - self._two_ms < TWO_MS:
            return f"two publish on {self._topic}, and which of them is the receiver cannot be told"
        if self._last is None:
            return self._why or f"no fix has come on {self._topic}"
        if now_ms - self._last.t_ms > MAX_AGE_MS:
            return self._why or f"the last fix is {(now_ms - self._last.t_ms) / 1_000:.1f} s old"
        return ""

    async def wait(self, timeout_s: float) -> None:
        """Until there is a fix. Raises PositionError."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._fresh.wait()
        except TimeoutError:
            raise PositionError(f"no position within {timeout_s:g} s: {self.why_not(self._clock())}") from None

    async def _take(self, arrived: Arrived) -> None:
        """One message. Raises DefinitionError for one that is no fix."""
        now_ms = self._clock()
        sender = arrived.attachment.gid
        if self._publisher not in {b"", sender} and now_ms - self._publisher_ms < TWO_MS:
            self._two_ms = now_ms
        self._publisher, self._publisher_ms = sender, now_ms
        kind = self._types.of_hash(arrived.type, arrived.type_hash)
        if kind.name != TYPE:
            self._say(f"{self._topic} has {kind.name}, not {TYPE}")
            return
        try:
            self._last = claim_of(kind.codec.decode(arrived.data), now_ms, 0 if self._last is None else self._last.t_ms)
        except FixError as error:
            self._say(f"a fix on {self._topic} is left out: {error}")
            return
        self._why = ""
        self._fresh.set()

    def _say(self, why: str) -> None:
        if why != self._why:
            _log.warning("%s", why)
        self._why = why
