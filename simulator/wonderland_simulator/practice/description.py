"""What a scenario file may say. Its check and its JSON Schema are the same definition.

Places are in the frame of a pad: east, north, up of its origin, in metres. Times are seconds since the start.
"""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, PlainValidator

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland.toml_settings import Address, read_address
from wonderland_simulator.flight import Vector

_Identifier = Annotated[str, Field(pattern=rf"^(?:{ID_PATTERN})$")]
_Metres = Annotated[float, Field(ge=-1_000, le=1_000, strict=True)]
_Seconds = Annotated[float, Field(ge=0, le=86_400, strict=True)]
_Place = tuple[_Metres, _Metres, _Metres]
_Spread = Annotated[float, Field(gt=0, le=50, strict=True)]
_Flag = Annotated[bool, Field(strict=True)]
NodeKind = Literal["DWM3001CDK", "QM35", "SR150", "ideal", "DWM1001"]
RangeLie = Literal[
    "per-anchor",
    "uniform",
    "delay",
    "mixed",
    "dropped",
    "silent-anchors",
    "random-reduction",
    "relay",
    "one-anchor",
    "anchor-moved",
]


def _address(value: object) -> Address:
    if not isinstance(value, str):
        raise ValueError("should be host:port in quotes")  # noqa: TRY004 - pydantic takes ValueErrors for refusals
    address = read_address(value)
    try:
        ipaddress.IPv4Address(address[0])
    except ValueError:
        raise ValueError("the host should be an IPv4 address, for example 127.0.0.1:5480") from None
    if not address[1]:
        raise ValueError("port 0 is nobody's; leave the field out to be given one")
    return address


_Address = Annotated[Address, PlainValidator(_address, json_schema_input_type=str)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Origin(_Part):
    """Where a pad's frame stands: degrees, and metres above the ellipsoid."""

    lat: Annotated[float, Field(ge=-80, le=80, strict=True)]
    lon: Annotated[float, Field(ge=-180, le=180, strict=True)]
    height_m: Annotated[float, Field(ge=-500, le=9_000, strict=True)]


class Pad(_Part):
    """A landing pad: a virtual node at each anchor of its survey."""

    pad_id: _Identifier
    name: Annotated[str, Field(max_length=100)] = ""
    origin: Origin
    survey: Path
    """CSV or TOML, as for ``wonderland pad commission``."""
    node: NodeKind = "DWM3001CDK"
    ports: Path | None = None
    """Directory in which its nodes' ports appear; ``ports/PAD_ID`` beside the file unless given."""
    remote_id: _Address | None = None
    """Where its Remote ID receiver listens (``remote_id.listen`` of pad.toml); assigned unless given."""
    reports: _Address | None = None
    """With DWM1001: where its drones report (``uwb.listen``); assigned unless given."""
    range_bias_m: dict[str, Annotated[float, Field(ge=-1, le=1, strict=True)]] = {}
    """Anchor → how much too long its ranges are: what commissioning finds."""
    clock_sigma_mm: Annotated[int, Field(ge=1, le=1_000, strict=True)] | None = None
    """How well its nodes share a clock; without, they share none."""
    buffer_mm: Annotated[int, Field(ge=100, le=100_000, strict=True)] = 1_000
    """Of the policy that ``wonderland world register`` proposes."""


class Waypoint(_Part):
    """Fly there, at most so fast, and wait."""

    east_m: _Metres
    north_m: _Metres
    up_m: Annotated[float, Field(ge=-100, le=1_000, strict=True)]
    speed_m_s: Annotated[float, Field(gt=0, le=30, strict=True)] = 5.0
    wait_s: _Seconds = 0.0


def place_of(waypoint: Waypoint) -> Vector:
    """East, north, up in metres."""
    return (waypoint.east_m, waypoint.north_m, waypoint.up_m)


class GnssDrag(_Part):
    """A spoofer leads its receiver away; the flags and the stated accuracy stay."""

    from_s: _Seconds = 0.0
    speed_m_s: Annotated[float, Field(gt=0, le=30, strict=True)] = 1.0
    bearing_deg: Annotated[float, Field(ge=0, le=360, strict=True)] = 60.0
    limit_m: Annotated[float, Field(gt=0, le=500, strict=True)] = 25.0


class GnssJump(_Part):
    """A spoofer puts its receiver elsewhere at once."""

    from_s: _Seconds = 0.0
    east_m: _Metres = 0.0
    north_m: _Metres = 0.0


class Lies(_Part):
    """What it does that an honest drone would not. All of it may go together."""

    gnss_drag: GnssDrag | None = None
    gnss_jump: GnssJump | None = None
    claim_off_m: _Place | None = None
    """Claim minus what its receiver says."""
    claim_share: Annotated[float, Field(gt=0, le=1, strict=True)] = 1.0
    """In how many of its claims it lies."""
    claim_mirrored: _Flag = False
    """It claims the place opposite, seen from the pad's middle."""
    accuracy_m: _Spread | None = None
    height_accuracy_m: _Spread | None = None
    """What it claims to know, at 95 %."""
    ranges: RangeLie | None = None
    """What its radio does to the ranges."""
    replay: _Flag = False
    """Its radio answers with frames that it overheard."""
    accomplice: _Flag = False
    """The radio with its keys is where it claims to be."""


class RemoteId(_Part):
    """What it broadcasts, to every pad within 1,500 m."""

    silent: _Flag = False
    serial: Annotated[str, Field(min_length=1, max_length=20, pattern=r"^[\x21-\x7e]+$")] | None = None
    """Instead of its own serial number."""
    off_m: tuple[_Metres, _Metres] = (0.0, 0.0)
    """How far off (east, north) it says that it is."""
    impostor_m: _Place | None = None
    """Where somebody else sends its serial number from."""
    also_to: Annotated[tuple[_Address, ...], Field(max_length=8)] = ()
    """Further addresses: its own agent (``--remote-id``), a receiver of yours."""


class Autopilot(_Part):
    """A real one in simulation flies the vehicle: ArduPilot's copter, which the world starts."""

    program: Path
    """``arducopter``, built for the board ``sitl``."""
    ground_station: _Address = Field(default="127.0.0.1:14550", validate_default=True)
    """Where it looks for whoever flies it: where QGroundControl, MAVProxy and MAVSDK listen by themselves."""
    parameters: Annotated[
        dict[Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]{0,15}$")], Annotated[float, Field(strict=True)]],
        Field(max_length=200),
    ] = {}
    """Beside those that fly a copter at once."""


class Vehicle(_Part):
    """A drone on its way: it starts at its first waypoint."""

    uav_id: Annotated[_Identifier, Field(max_length=20)]
    """The serial number that it broadcasts."""
    model: Annotated[str, Field(min_length=1, max_length=64)] = "Practice"
    pad: _Identifier
    """In whose frame its way is."""
    node: NodeKind | None = None
    """As the pad's, unless given."""
    port: Path | None = None
    """Where its node's port appears; ``ports/UAV_ID`` beside the file unless given."""
    position: _Address | None = None
    """Where its autopilot sends its position (``--position udp:…``); assigned unless given."""
    autopilot: Autopilot | None = None
    """A real one in simulation; then its path is the one place where it stands at first."""
    path: Annotated[tuple[Waypoint, ...], Field(min_length=1, max_length=1_000)]
    repeat: _Flag = False
    """From the last waypoint back to the first, and again."""
    start_s: _Seconds = 0.0
    gnss_sigma_m: Annotated[float, Field(gt=0, le=50, strict=True)] = 0.02
    lies: Lies = Lies()
    remote_id: RemoteId = RemoteId()
    track: Path | None = None
    """Where it was is written here (t, x, y, z): the --reference of a calibration run."""


class Fault(_Part):
    """Something happens to a node at a time."""

    at_s: _Seconds
    node: str
    """``PAD_ID/ANCHOR`` or a vehicle's ``uav_id``."""
    what: Literal["unplug", "hang", "return", "move"]
    """Its port vanishes; it answers nothing any more; it is back, as after a restart; its anchor is moved."""
    by_m: _Place | None = None
    """With ``move``: how far."""


class ScenarioFile(_Part):
    """Pads, vehicles, and what happens to their nodes."""

    pads: Annotated[tuple[Pad, ...], Field(min_length=1, max_length=16)]
    vehicles: Annotated[tuple[Vehicle, ...], Field(max_length=64)] = ()
    faults: Annotated[tuple[Fault, ...], Field(max_length=1_000)] = ()
    seed: Annotated[int, Field(ge=0, le=2**31, strict=True)] = 1
    """Same seed, same noise."""
