"""How a drone behaves at a pad: the ``[flight]`` table of ``uav.toml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wonderland.toml_settings import FieldError, Table

_Metres = Annotated[float, Meta(gt=0, le=200)]


class Alternate(Table, frozen=True):
    """Where to hold instead, in degrees (WGS-84) and metres above the ellipsoid."""

    lat: Annotated[float, Meta(ge=-90, le=90)]
    """Latitude, in degrees (WGS-84)."""
    lon: Annotated[float, Meta(ge=-180, le=180)]
    """Longitude, in degrees."""
    height_m: Annotated[float, Meta(ge=-500, le=9_000)]
    """Height above the ellipsoid."""


class FlightSettings(Table, frozen=True, kw_only=True):
    """Raises FieldError where two of them contradict each other."""

    approach_m: _Metres = 20.0
    """Whoever begins to land so near to a pad's middle is held."""
    gate_m: _Metres = 8.0
    """Height of the place above the pad's middle at which it waits for the verdict."""
    attempts: Annotated[int, Meta(ge=1, le=10)] = 3
    """Proofs before the landing counts as refused."""
    refused: Literal["hold", "return", "alternate"] = "hold"
    """Then: stay above the pad, return to launch, or go to the alternate and stay there."""
    alternate: Alternate | None = None
    memory: Path | None = None
    """A file that remembers where it is held, so that a restart of the agent takes it up."""
    precision: bool = True
    """Whether the way down is found by the ranges (LANDING_TARGET); else by the autopilot's position alone."""
    go_arounds: Annotated[int, Meta(ge=0, le=20)] = 3
    """So often one that wind takes from above its pad, by the ranges, begins its way down again; then it is held."""
    take_off_elsewhere: Literal["refuse", "allow"] = "refuse"
    """Whether it may be armed where none of its pads is; asked by PX4 alone."""

    def __post_init__(self) -> None:
        if (self.refused == "alternate") != (self.alternate is not None):
            raise FieldError('alternate: give it together with refused = "alternate"')
