"""An approach to a pad: where it stands, and what its gatekeeper orders."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from wonderland.proofs.records.pads import Frame


@dataclass(frozen=True, slots=True)
class Gate:
    """A pad at which this drone proves itself."""

    pad_id: str
    frame: Frame


@dataclass(frozen=True, slots=True)
class GoTo:
    """Go there and stay: WGS-84, height above the ellipsoid."""

    lat_e7: int
    lon_e7: int
    height_mm: int


@dataclass(frozen=True, slots=True)
class Land:
    """Land here."""


@dataclass(frozen=True, slots=True)
class Return:
    """Return to launch."""


@dataclass(frozen=True, slots=True)
class Prove:
    """Begin a proof."""

    pad_id: str


@dataclass(frozen=True, slots=True)
class Tell:
    """Say this to whoever reads the log."""

    text: str


@dataclass(frozen=True, slots=True)
class Report:
    """It came down at a pad without a permission: for the ledger, and the log. ``cause`` as the contract has it."""

    pad_id: str
    cause: str
    text: str


Order = GoTo | Land | Return | Prove | Tell | Report


class Phase(StrEnum):
    """Where one approach stands."""

    WATCHING = "watching"
    TO_GATE = "to_gate"
    PROVING = "proving"
    TO_PAD = "to_pad"
    LANDING = "landing"
    REFUSED = "refused"
    OVERRIDDEN = "overridden"
