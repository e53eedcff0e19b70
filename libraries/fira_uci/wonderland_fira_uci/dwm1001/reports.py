"""What a DWM1001 tells its host, whichever way it said it: distances, positions, its firmware."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple


class Generation(Enum):
    """Whose firmware answers: the two spell ``loc_get`` differently."""

    PANS_R2 = "PANS R2"
    """Decawave/Qorvo's own, on the paper's boards."""
    LEAPS = "LEAPS"
    """Its successor (PANS PRO, LEAPS RTLS): options in the request, time stamp and flags in the answer."""


class BoardPosition(NamedTuple):
    """A position in the frame in which the network's anchors were entered. Quality 1 to 100, None where not told."""

    x_mm: int
    y_mm: int
    z_mm: int
    quality_percent: int | None = None


MIN_QUALITY_PERCENT: Final = 50
"""The makers' examples have 95 and 100; what a board rates below half is left out: rounds cost less than doubt."""


class AnchorDistance(NamedTuple):
    """One range of a tag. ``range_mm`` is None where the board gave none (``nan``, 0 or absurd).

    ``address``: the anchor's, 16 bits (64 in the list of a PANS anchor). ``position``: where the network believes the
    anchor to be, if told; a pad goes by its own survey instead. ``quality_percent`` is None in the shell's lines.
    """

    address: int
    range_mm: int | None
    quality_percent: int | None = None
    position: BoardPosition | None = None

    @property
    def usable_mm(self) -> int | None:
        """The range, where there is one and the board itself thinks it worth something."""
        rated = self.quality_percent
        return self.range_mm if rated is None or rated >= MIN_QUALITY_PERCENT else None


@dataclass(frozen=True, slots=True)
class LocationReport:
    """One round of a tag: its distances to up to 15 anchors, and the board's own estimate where it has one.

    ``device_us``: the board's clock in microseconds, 32 bits (LEAPS only). ``moving``: LEAPS' motion flag. ``damaged``:
    the line arrived spliced and only its whole parts are here.
    """

    distances: tuple[AnchorDistance, ...]
    position: BoardPosition | None = None
    device_us: int | None = None
    moving: bool | None = None
    damaged: bool = False


@dataclass(frozen=True, slots=True)
class HeardPosition:
    """A passive listener heard the tag ``address`` say where it believes to be. It is hearsay: no range is in it."""

    address: int
    position: BoardPosition | None


@dataclass(frozen=True, slots=True)
class Version:
    """``dwm_ver_get``: firmware as major.minor.patch.variant, configuration and hardware as the board numbers them."""

    firmware: tuple[int, int, int, int]
    configuration: int
    hardware: int

    @property
    def text(self) -> str:
        """The firmware's version for people, for example ``1.3.0``."""
        return ".".join(str(part) for part in self.firmware[:3])


UWB_ACTIVE: Final = 2


@dataclass(frozen=True, slots=True)
class Configuration:
    """``dwm_cfg_get``, of which this host needs the role. ``uwb_mode``: 0 off, 1 passive, 2 active."""

    is_anchor: bool
    uwb_mode: int = UWB_ACTIVE

    def problem(self, *, as_anchor: bool) -> str:
        """Why a board so configured cannot do the work of an anchor, or of a tag; empty where it can."""
        if self.is_anchor != as_anchor:
            return f"the board is configured as {'an anchor' if self.is_anchor else 'a tag'}, which here it must not be"
        if self.uwb_mode != UWB_ACTIVE:
            return f"the board's radio is {'passive' if self.uwb_mode == 1 else 'switched off'}"
        return ""


Report = LocationReport | HeardPosition
