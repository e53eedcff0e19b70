"""Positions from ROS 2, by the wire of rmw_zenoh: a topic of fixes or of odometry, or PX4's own topics.

Whoever reaches this machine's graph can publish on a topic; two publishers at once, or two in one name, are heard as
none.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from wonderland.clock import Clock
from wonderland.geoid import Geoid
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.fixes import FixError, claim_of
from wonderland_uav_agent.position.mavlink.attitude import Vector
from wonderland_uav_agent.position.odometry import Odometry, OdometrySettings
from wonderland_uav_agent.position.px4 import Px4
from wonderland_uav_agent.position.px4_messages import ATTITUDE, DEFINITIONS, GPS, POSITION
from wonderland_uav_agent.position.receiver import MAX_AGE_MS
from wonderland_uav_agent.position.source import PositionError
from wonderland_uav_agent.position.voices import Voices

if TYPE_CHECKING:
    from wonderland_rmw_zenoh.interfaces import Interfaces, MessageType
    from wonderland_rmw_zenoh.node import Arrived, Node

_log = logging.getLogger(__name__)

FORM: Final = "ros2:/TOPIC[@tcp/127.0.0.1:PORT] or ros2:px4[:/NAMESPACE][@tcp/127.0.0.1:PORT]"
FIX: Final = "sensor_msgs/msg/NavSatFix"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
PX4: Final = "px4"
MAX_BYTES: Final = 4_096
DEPTH: Final = 2
"""How many messages wait for this process: an older one is worth nothing."""
SAY_MS: Final = 1_000
"""At most one line of the log in this time."""


class Hearing:
    """A node that hears topics, each message with its type, from one publisher. Use as an asynchronous context manager.

    What a subclass makes of the messages is its claim.
    """

    def __init__(self, text: str, address: str, clock: Clock, interfaces: Sequence[Path]) -> None:
        """Raises PositionError; ``text`` is what was asked for, ``address`` that of a router or peer."""
        try:
            from wonderland_rmw_zenoh.interfaces import Interfaces  # noqa: PLC0415 - an extra
            from wonderland_rmw_zenoh.node import Node  # noqa: PLC0415
            from wonderland_rmw_zenoh.session import ROUTER, Link  # noqa: PLC0415
        except ImportError:
            raise PositionError(
                '--position ros2:…: install what it needs: pip install "wonderland-uav-agent[ros2]"'
            ) from None
        link = Link(connect=(address or ROUTER,))
        if problem := link.problem():
            raise PositionError(f"--position ros2:{text}: {problem}; give {FORM}")
        self._text = text
        self._clock = clock
        self._types: Interfaces = Interfaces(interfaces)
        self._node: Node = Node("/wonderland_uav", link)
        self._voices: dict[str, Voices] = {}
        self._whys: dict[str, str] = {}
        self._said_ms = 0
        self._fresh = asyncio.Event()

    async def __aenter__(self) -> Self:
        from wonderland_rmw_zenoh.errors import Ros2Error  # noqa: PLC0415

        try:
            await self._node.__aenter__()
            self._subscribe()
        except Ros2Error as cause:
            raise PositionError(f"--position ros2:{self._text}: {cause}") from cause
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._node.__aexit__(kind, error, trace)

    def claim(self, now_ms: int) -> Claim | None:
        """The position now; None while there is none that is fresh, or when two publish."""
        raise NotImplementedError

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        raise NotImplementedError

    async def wait(self, timeout_s: float) -> None:
        """Until there is a position. Raises PositionError."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._fresh.wait()
        except TimeoutError:
            raise PositionError(f"no position within {timeout_s:g} s: {self.why_not(self._clock())}") from None

    def _subscribe(self) -> None:
        raise NotImplementedError

    def _hear(self, topic: str, kind: MessageType, take: Callable[[Arrived, int], None]) -> None:
        """Hear a topic from now on. ``take`` may raise DefinitionError."""
        from wonderland_rmw_zenoh.errors import DefinitionError  # noqa: PLC0415

        voices = self._voices[topic] = Voices(topic)

        async def heard(arrived: Arrived) -> None:
            now_ms = self._clock()
            voices.heard(arrived.attachment.gid, arrived.attachment.seq, now_ms)
            try:
                take(arrived, now_ms)
            except DefinitionError as error:
                self._say(topic, f"{topic}: {error}", now_ms)

        self._node.subscribe(topic, heard, depth=DEPTH, max_message_bytes=MAX_BYTES, kind=kind, history=False)

    def _doubled(self, now_ms: int) -> str:
        return next((why for each in self._voices.values() if (why := each.why_not(now_ms))), "")

    def _why(self) -> str:
        """Why messages were left out that came last, by whichever topic."""
        return "; ".join(self._whys.values())

    def _well(self, topic: str) -> None:
        self._whys.pop(topic, None)

    def _say(self, topic: str, why: str, now_ms: int) -> None:
        """A message was left out. A flood of bad ones fills no log."""
        if why != self._whys.get(topic) and not 0 <= now_ms - self._said_ms < SAY_MS:
            _log.warning("%s", why)
            self._said_ms = now_ms
        self._whys[topic] = why


class TopicPosition(Hearing):
    """The last fix, or pose of an odometry, that arrived, while it is fresh."""

    def __init__(
        self, text: str, address: str, clock: Clock, interfaces: Sequence[Path] = (), odometry: Odometry | None = None
    ) -> None:
        super().__init__(text, address, clock, interfaces)
        self._topic = text
        self._odometry = odometry
        self._type = FIX if odometry is None else ODOMETRY
        self._last: Claim | None = None

    def claim(self, now_ms: int) -> Claim | None:
        """The last one; None when it is more than a second old, or when two publish."""
        return None if self.why_not(now_ms) else self._last

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        if doubled := self._doubled(now_ms):
            return doubled
        if self._last is None:
            return self._why() or f"no fix has come on {self._topic}"
        if now_ms - self._last.t_ms > MAX_AGE_MS:
            return self._why() or f"the last fix is {(now_ms - self._last.t_ms) / 1_000:.1f} s old"
        return ""

    def _subscribe(self) -> None:
        self._hear(self._topic, self._types.message(self._type), self._take)

    def _take(self, arrived: Arrived, now_ms: int) -> None:
        kind = self._types.of_hash(arrived.type, arrived.type_hash)
        if kind.name != self._type:
            hint = "; [odometry] says where its frame lies" if kind.name == ODOMETRY else ""
            self._say(self._topic, f"{self._topic} has {kind.name}, not {self._type}{hint}", now_ms)
            return
        message, after_ms = kind.codec.decode(arrived.data), 0 if self._last is None else self._last.t_ms
        try:
            if self._odometry is None:
                self._last = claim_of(message, now_ms, after_ms)
            else:
                self._last = self._odometry.claim_of(message, arrived.attachment.gid, now_ms, after_ms)
        except FixError as error:
            self._say(self._topic, f"a fix on {self._topic} is left out: {error}", now_ms)
            return
        self._well(self._topic)
        self._fresh.set()


class Px4Position(Hearing):
    """What PX4's filter makes of its sensors, by its own topics."""

    def __init__(
        self,
        text: str,
        address: str,
        clock: Clock,
        interfaces: Sequence[Path] = (),
        geoid: Geoid | None = None,
        antenna_m: Vector = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__(text, address, clock, interfaces)
        space = text.removeprefix(PX4).removeprefix(":")
        self._px4 = Px4(_log.warning, geoid, antenna_m)
        self._takes: dict[str, tuple[str, Callable[[Any, int], None]]] = {
            f"{space}/fmu/out/vehicle_gps_position": (GPS, self._px4.gps),
            f"{space}/fmu/out/vehicle_global_position": (POSITION, self._px4.position),
        }
        if any(antenna_m):
            self._takes[f"{space}/fmu/out/vehicle_attitude"] = ATTITUDE, self._px4.attitude
        self._known: dict[tuple[str, str], MessageType] = {}
        self._has_interfaces = bool(interfaces)

    def claim(self, now_ms: int) -> Claim | None:
        """The position now; None while there is none that is fresh and complete, or when two publish."""
        return None if self.why_not(now_ms) else self._px4.claim(now_ms)

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        if why := self._doubled(now_ms) or self._px4.why_not(now_ms):
            left_out = self._why()
            return f"{why} ({left_out})" if left_out else why
        return ""

    def _subscribe(self) -> None:
        self._known = known_types()
        for topic, (kind, take) in self._takes.items():
            newest = next(each for (name, _), each in self._known.items() if name == kind)
            self._hear(topic, newest, self._taker(topic, kind, take))

    def _taker(self, topic: str, wanted: str, take: Callable[[Any, int], None]) -> Callable[[Arrived, int], None]:
        def took(arrived: Arrived, now_ms: int) -> None:
            message = decoded(self._type(arrived, wanted), arrived.data)
            try:
                take(message, now_ms)
            except AttributeError as cause:
                self._say(topic, f"{topic}: its type, as --interfaces has it, has no field {cause.name}", now_ms)
                return
            self._well(topic)
            if self._px4.claim(now_ms) is not None:
                self._fresh.set()

        return took

    def _type(self, arrived: Arrived, wanted: str) -> MessageType:
        """Raises DefinitionError for a type that is not the wanted one, or of which nobody says what it is."""
        from wonderland_rmw_zenoh.errors import DefinitionError  # noqa: PLC0415

        if arrived.type != wanted:
            raise DefinitionError(f"it has {arrived.type}, not {wanted}")
        known = self._known.get((arrived.type, arrived.type_hash))
        if known is not None or self._has_interfaces:
            return known or self._types.of_hash(arrived.type, arrived.type_hash)
        raise DefinitionError(
            f"PX4's {wanted} has type hash {arrived.type_hash}, which none of the releases known here has; give the "
            "px4_msgs that it was built with: --interfaces DIRECTORY"
        )


def known_types() -> dict[tuple[str, str], MessageType]:
    """By name and hash, the newest first."""
    from wonderland_rmw_zenoh.definitions import Codec, parse  # noqa: PLC0415
    from wonderland_rmw_zenoh.interfaces import MessageType  # noqa: PLC0415
    from wonderland_rmw_zenoh.type_hash import type_hash  # noqa: PLC0415

    definitions = [parse(kind, text) for kind, texts in DEFINITIONS.items() for text in texts]
    made = [MessageType(each.type, type_hash(each), Codec(each)) for each in definitions]
    return {(each.name, each.hash): each for each in made}


def decoded(kind: MessageType, data: bytes) -> Any:
    """A message of PX4's, whose Zenoh module sends its whole buffer: what follows the message is no part of it.

    Raises DefinitionError.
    """
    return kind.codec.decode(data[: len(kind.codec.encode({}))])


def open_ros2(
    text: str,
    clock: Clock,
    *,
    interfaces: Sequence[Path] = (),
    geoid: Geoid | None = None,
    antenna_m: Vector = (0.0, 0.0, 0.0),
    odometry: OdometrySettings | None = None,
) -> Hearing:
    """What follows ``ros2:``. Raises PositionError."""
    named, _, address = text.partition("@")
    is_px4 = named.partition(":")[0] == PX4
    topic = named.removeprefix(PX4).removeprefix(":") if is_px4 else named
    if not (is_px4 and topic == "") and not _is_name(topic):
        raise PositionError(f"--position ros2:{text[:200]}: {topic[:100]!r} is no topic; give {FORM}")
    if odometry is not None and is_px4:
        raise PositionError("[odometry]: only with --position ros2:/TOPIC; PX4 tells latitude and longitude itself")
    if is_px4:
        return Px4Position(named, address, clock, interfaces, geoid, antenna_m)
    if geoid is not None:
        raise PositionError(f"--geoid: only with mavlink:… or ros2:px4; {topic} gives heights above the ellipsoid")
    if any(antenna_m) and odometry is None:
        raise PositionError(f"--antenna: only with mavlink:…, ros2:px4 or [odometry]; a fix of {topic} has no attitude")
    return TopicPosition(named, address, clock, interfaces, None if odometry is None else Odometry(odometry, antenna_m))


def _is_name(topic: str) -> bool:
    try:
        from wonderland_rmw_zenoh.wire import is_name  # noqa: PLC0415
    except ImportError:
        return True  # what is missing is said by who opens it
    return is_name(topic)
