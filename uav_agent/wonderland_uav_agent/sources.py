"""What ``--position``, ``--geoid`` and ``--remote-id`` name."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Final

import click

from wonderland.clock import Clock
from wonderland.geoid import Geoid, GeoidError
from wonderland_uav_agent.broadcasts import BroadcastError, BroadcastSource, OpenDroneIdSettings, RemoteIdModule
from wonderland_uav_agent.broadcasts.autopilot import AutopilotBroadcasts
from wonderland_uav_agent.broadcasts.telling import Telling
from wonderland_uav_agent.position import AutopilotPosition, PositionError, TellingPosition, TrackPosition
from wonderland_uav_agent.position.mavlink import (
    Address,
    MavlinkPosition,
    SerialAddress,
    UdpAddress,
    parse_address,
)
from wonderland_uav_agent.position.mavlink.address import FORMS
from wonderland_uav_agent.position.mavlink.attitude import Vector
from wonderland_uav_agent.position.mavlink.signing import read_key
from wonderland_uav_agent.position.odometry import OdometrySettings
from wonderland_uav_agent.position.ros2 import FORM as ROS2_FORM
from wonderland_uav_agent.position.ros2 import open_ros2

POSITION_PATIENCE_S: Final = 10.0
AUTOPILOT_PATIENCE_S: Final = 60.0
"""ArduPilot takes some 40 s from its start until it uses GPS."""
SAY_AFTER_S: Final = 3.0
_TURNING: Final = frozenset({"mavlink", "ros2"})
"""Whose place may be another than the antenna's."""
LOOPBACK: Final = frozenset({"127.0.0.1", "::1", "localhost"})


@contextlib.asynccontextmanager
async def open_position(
    text: str,
    clock: Clock,
    geoid: Path | None = None,
    *,
    antenna_m: Vector = (0.0, 0.0, 0.0),
    wait: bool,
    key_file: Path | None = None,
    interfaces: Sequence[Path] = (),
    odometry: OdometrySettings | None = None,
    crew: Callable[[MavlinkPosition], None] | None = None,
) -> AsyncIterator[TellingPosition]:
    """A source as ``--position`` names it; ``crew`` boards an autopilot's link. Raises PositionError."""
    kind, _, rest = text.partition(":")
    if key_file is not None and kind != "mavlink":
        raise click.UsageError("--mavlink-key: only with --position mavlink:…")
    if any(antenna_m) and kind not in _TURNING:
        raise PositionError("--antenna: not with this --position: what it tells is the antenna's place")
    if geoid is not None and kind not in _TURNING:
        raise PositionError("--geoid: not with this --position: it gives heights above the ellipsoid")
    if kind != "ros2" and (interfaces or odometry is not None):
        raise PositionError("--interfaces and [odometry]: only with --position ros2:…")
    if kind == "mavlink":
        source = _autopilot(rest, clock, geoid, key_file, antenna_m, flown=crew is not None)
        if crew is not None:
            crew(source)
        async with source as autopilot:
            if wait:
                await _wait_for(autopilot, clock)
            yield autopilot
        return
    if crew is not None:
        raise PositionError("[flight]: an autopilot is held by MAVLink alone; give --position mavlink:…")
    if kind == "ros2":
        heights = _geoid(geoid)
        made = open_ros2(rest, clock, interfaces=interfaces, geoid=heights, antenna_m=antenna_m, odometry=odometry)
        async with made as heard:
            if wait:
                await heard.wait(POSITION_PATIENCE_S)
            yield heard
        return
    if kind == "track" and rest:
        yield TrackPosition.load(Path(rest), clock())
        return
    listen = _udp(text)
    if listen is None:
        raise PositionError(f"--position {text}: give {FORMS}, {ROS2_FORM}, udp:HOST:PORT or track:FILE")
    async with AutopilotPosition(listen, clock) as told:
        if wait:
            await told.wait(POSITION_PATIENCE_S)
        yield told


async def _wait_for(autopilot: MavlinkPosition, clock: Clock) -> None:
    """Says meanwhile what it waits for. Raises PositionError."""
    with contextlib.suppress(PositionError):
        await autopilot.wait(min(SAY_AFTER_S, AUTOPILOT_PATIENCE_S))
        return
    left_s = AUTOPILOT_PATIENCE_S - SAY_AFTER_S
    if left_s > 0:
        click.echo(f"Waiting for a position (up to {left_s:g} s more): {autopilot.why_not(clock())}", err=True)
    await autopilot.wait(max(left_s, 0.0))


def needs_key(where: Address, key_file: Path | None, *, flown: bool) -> None:
    """Raises PositionError where an autopilot would be flown over a network that others reach, without signatures."""
    if flown and key_file is None and not isinstance(where, SerialAddress) and where.host not in LOOPBACK:
        raise PositionError(
            f"[flight] with {where}: whoever reaches this network could land and arm the drone; give --mavlink-key (of "
            "MAVLink signing, which the autopilot has, too), a serial line or 127.0.0.1"
        )


def _autopilot(
    text: str, clock: Clock, geoid_file: Path | None, key_file: Path | None, antenna_m: Vector, *, flown: bool
) -> MavlinkPosition:
    where = parse_address(text)
    key = None if key_file is None else read_key(key_file)
    needs_key(where, key_file, flown=flown)
    if isinstance(where, UdpAddress) and where.host not in LOOPBACK and key is None:
        click.echo(
            f"--position {where}: whoever reaches this address can say where the drone is; use 127.0.0.1, or a network "
            "that nobody else is in",
            err=True,
        )
    return MavlinkPosition(where, clock, _geoid(geoid_file), key=key, antenna_m=antenna_m)


def _geoid(file: Path | None) -> Geoid | None:
    try:
        return Geoid(file) if file is not None else None
    except GeoidError as error:
        raise PositionError(f"--geoid: {error}") from None


def _udp(text: str) -> tuple[str, int] | None:
    """``udp:HOST:PORT``, or None."""
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind != "udp" or not host or not (port.isascii() and port.isdigit()) or int(port) > 0xFFFF:
        return None
    return host, int(port)


@contextlib.asynccontextmanager
async def open_broadcasts(
    text: str, uav_id: str, clock: Clock, position: TellingPosition
) -> AsyncIterator[BroadcastSource]:
    """What is broadcast, as ``--remote-id`` names it. Raises BroadcastError."""
    if text == "mavlink":
        heard = AutopilotBroadcasts(uav_id, clock)
        autopilot_of(position, "--remote-id mavlink").tell_of_remote_id(heard)
        yield heard
        return
    listen = _udp(text)
    if listen is None:
        raise BroadcastError(f"--remote-id {text}: give mavlink or udp:HOST:PORT")
    if listen[0] not in LOOPBACK:
        click.echo(
            f"--remote-id {text}: whoever reaches this address has the drone sign for what he sends; use 127.0.0.1",
            err=True,
        )
    async with RemoteIdModule(listen, uav_id, clock) as module:
        yield module


def tell_autopilot(settings: OpenDroneIdSettings, uav_id: str, position: TellingPosition) -> None:
    """``[open_drone_id]``: what it broadcasts and cannot know. Raises BroadcastError."""
    link = autopilot_of(position, "[open_drone_id]")
    link.join(Telling(settings, uav_id, followed=lambda: link.navigator.sender, claim=link.claim))


def autopilot_of(position: TellingPosition, who: str) -> MavlinkPosition:
    """Raises BroadcastError where it is none."""
    if not isinstance(position, MavlinkPosition):
        raise BroadcastError(f"{who}: only with --position mavlink:…, by whose link it is")
    return position
