"""What a drone's own node adds to every range (its antenna delay), measured at a pad, by somebody else than its owner.

Measured is the difference to the tag with which that pad was commissioned, whose delay is in the anchors' bias tables;
so a calibration holds at the pad, and under the commissioning, at which it was made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs.records.fields import LocalMm, MspId, Name, Note, PadId, SessionId, Sha256Hex, TimeMs
from wonderland.proofs.records.schema import Integer, Items, Record

MAX_OFFSET_MM: Final = 500
"""Nodes whose antenna delay nobody set differ by 0.2 to 0.37 m in public data; more is no delay, but another place."""
SIGMA_FLOOR_MM: Final = 20
"""No calibration knows an offset better: day to day (15 mm), the reference (10 mm), the place's reflections."""
MAX_SIGMA_MM: Final = 200
MAX_CALIBRATIONS: Final = 32
"""Of one drone, one for each pad."""
MAX_SESSIONS: Final = 8

OffsetMm = Annotated[
    int, Integer(-MAX_OFFSET_MM, MAX_OFFSET_MM, "How much longer than the commissioned tag's all of its ranges are")
]
OffsetSigmaMm = Annotated[int, Integer(SIGMA_FLOOR_MM, MAX_SIGMA_MM, "Standard deviation of the offset")]


@dataclass(frozen=True, kw_only=True, slots=True)
class DroneOffset(Record):
    """The calibration of a drone that a session is judged with, as it stood when the drone asked."""

    offset_mm: OffsetMm
    sigma_mm: OffsetSigmaMm
    measured_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class RangedAt(Record):
    """A session in which the drone was ranged, and where its antenna stood then, as the pad's side knows it."""

    session_id: SessionId
    east_mm: LocalMm
    north_mm: LocalMm
    up_mm: LocalMm


@dataclass(frozen=True, kw_only=True, slots=True)
class Calibration(Record):
    """The offset of a drone's ranges at one pad."""

    pad_id: PadId
    commissioning_sha256: Sha256Hex
    offset_mm: OffsetMm
    sigma_mm: OffsetSigmaMm
    sessions: Annotated[int, Integer(1, MAX_SESSIONS, "In which it was ranged; the transaction names them")]
    rounds: Annotated[int, Integer(1, 10_000, "Usable rounds of these sessions")]
    measured_ms: TimeMs
    valid_until_ms: TimeMs
    registered_ms: TimeMs
    registered_by: Name
    msp_id: MspId
    node: Note | None = None
    withdrawn: Note | None = None
    """Why it holds no longer, where somebody said so."""


CalibrationSessions = Annotated[tuple[RangedAt, ...], Items(1, MAX_SESSIONS)]
