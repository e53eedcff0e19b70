"""Landing pads: who operates them, where their anchors are, which one-time keys they offer."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.fields import (
    AnchorId,
    HeightMm,
    LatE7,
    LocalMm,
    LonE7,
    MspId,
    Name,
    Note,
    OperatorId,
    PadId,
    PrekeyId,
    PublicKey,
    Sha256Hex,
    TimeMs,
)
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.schema import Choice, Integer, Items, Record


@dataclass(frozen=True, kw_only=True, slots=True)
class Frame(Record):
    """A pad's local frame: its origin and the integer coefficients that turn WGS-84 differences into millimetres.

    With dφ, dλ in degrees × 10⁷ and dh in mm, all from the origin:
    east = E1·dλ/2³² + (E2·dφ·dλ + E3·dλ·dh)/2⁵², north = N1·dφ/2³² + (N2·dφ² + N3·dλ² + N4·dφ·dh)/2⁵²,
    up = dh + (U2·dφ² + U3·dλ²)/2⁵².
    """

    lat_e7: LatE7
    lon_e7: LonE7
    height_mm: HeightMm
    e1: Annotated[int, Integer(-(2**40), 2**40)]
    e2: Annotated[int, Integer(-(2**40), 2**40)]
    e3: Annotated[int, Integer(-(2**40), 2**40)]
    n1: Annotated[int, Integer(0, 2**40)]
    n2: Annotated[int, Integer(-(2**40), 2**40)]
    n3: Annotated[int, Integer(-(2**40), 2**40)]
    n4: Annotated[int, Integer(-(2**40), 2**40)]
    u2: Annotated[int, Integer(-(2**40), 2**40)]
    u3: Annotated[int, Integer(-(2**40), 2**40)]


@dataclass(frozen=True, kw_only=True, slots=True)
class BiasPoint(Record):
    """Mean error of an anchor's ranges at a distance, and how well it is known."""

    range_mm: Annotated[int, Integer(0, 1_000_000)]
    bias_mm: Annotated[int, Integer(-5_000, 5_000, "Measured minus true range")]
    sigma_mm: Annotated[int, Integer(0, 5_000, "Standard deviation of the bias after correction")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Anchor(Record):
    """One UWB node of a pad, surveyed in the pad's frame."""

    anchor_id: AnchorId
    mac: Annotated[int, Integer(0, 0xFFFF, "Short UWB address")]
    east_mm: LocalMm
    north_mm: LocalMm
    up_mm: LocalMm
    survey_sigma_mm: Annotated[int, Integer(0, 10_000, "Standard deviation of each surveyed coordinate")]
    bias: Annotated[tuple[BiasPoint, ...], Items(1, 32, "By rising distance; linear between, constant beyond")]
    clock_offset_mm: (
        Annotated[int, Integer(-100_000, 100_000, "Mean error of its time stamps on the pad's clock, as a length")]
        | None
    ) = None
    clock_sigma_mm: (
        Annotated[
            int,
            Integer(0, 10_000, "Its standard deviation: clock synchronisation, antenna. Without it: no common clock"),
        ]
        | None
    ) = None

    def validate(self, path: str) -> None:
        """Distances of the bias table must rise."""
        for before, after in pairwise(self.bias):
            if after.range_mm <= before.range_mm:
                raise RecordError(f"{path}.bias" if path else "bias", "distances must rise")


@dataclass(frozen=True, kw_only=True, slots=True)
class Commissioning(Record):
    """What a survey and a calibration established about a pad: the ground on which its verdicts stand."""

    frame: Frame
    anchors: Annotated[tuple[Anchor, ...], Items(3, 16)]
    range_sigma_mm: Annotated[int, Integer(1, 10_000, "Standard deviation of one range, white part")]
    installation_sigma_mm: Annotated[int, Integer(0, 5_000, "Standard deviation of the bias common to all anchors")]
    max_range_mm: Annotated[int, Integer(1_000, 1_000_000, "Beyond this distance the calibration says nothing")]
    valid_from_ms: TimeMs
    valid_until_ms: TimeMs
    method: Note
    correlation_ppm: (
        Annotated[int, Integer(0, 950_000, "Correlation of one round's errors with the next one's, as commissioned")]
        | None
    ) = None
    timestamp_sigma_mm: (
        Annotated[int, Integer(1, 10_000, "Standard deviation of one time stamp of a frame, white part, as a length")]
        | None
    ) = None
    bias_length_mm: (
        Annotated[
            int,
            Integer(
                500, 20_000, "Way over which an anchor's bias changes (exp(−d/L)); without it, it is the same all over"
            ),
        ]
        | None
    ) = None
    bias_fixed_ppm: (
        Annotated[
            int, Integer(100_000, 1_000_000, "Share of the bias's variance that is the same wherever the drone is")
        ]
        | None
    ) = None

    nodes: NodeAbility | None = None
    """What the weakest of the pad's nodes can do; without it, what published stacks can."""

    def validate(self, path: str) -> None:
        """Anchors distinct in name and address, a validity that is not empty, both of the bias's fields over place."""
        prefix = f"{path}." if path else ""
        for field in ("anchor_id", "mac"):
            if len({getattr(anchor, field) for anchor in self.anchors}) != len(self.anchors):
                raise RecordError(f"{prefix}anchors", f"two anchors have the same {field}")
        if self.valid_until_ms <= self.valid_from_ms:
            raise RecordError(f"{prefix}valid_until_ms", "must be after valid_from_ms")
        if (self.bias_length_mm is None) != (self.bias_fixed_ppm is None):
            raise RecordError(f"{prefix}bias_length_mm", "stands with bias_fixed_ppm, or neither does")


@dataclass(frozen=True, kw_only=True, slots=True)
class Pad(Record):
    """A landing pad as the ledger knows it."""

    pad_id: PadId
    name: Name
    operator_id: OperatorId
    msp_id: MspId
    status: Annotated[str, Choice(("registered", "commissioned", "retired"))]
    lat_e7: LatE7
    lon_e7: LonE7
    height_mm: HeightMm
    registered_ms: TimeMs
    updated_ms: TimeMs
    commissioning: Commissioning | None = None
    commissioning_sha256: Sha256Hex | None = None
    site_plan_sha256: Sha256Hex | None = None
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Prekey(Record):
    """A pad's one-time key for the agreement of a session's keys; a request consumes it."""

    pad_id: PadId
    prekey_id: PrekeyId
    public_key: PublicKey
    msp_id: MspId
    certificate_sha256: Sha256Hex
    published_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class OfferedPrekey(Record):
    """A prekey as the pad publishes it."""

    prekey_id: PrekeyId
    public_key: PublicKey
