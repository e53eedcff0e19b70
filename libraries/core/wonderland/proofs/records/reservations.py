"""Reservations of a pad: for which drone it is kept, from when until when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.fields import MspId, Name, PadId, TimeMs, UavId
from wonderland.proofs.records.schema import Items, Record, Text

MAX_RESERVATIONS: Final = 60
"""Of a pad, those that are over included; about 20 kB."""
EACH: Final = 3
"""Of an organisation at a pad."""
AHEAD_MS: Final = 7 * 86_400_000
LONGEST_MS: Final = 3_600_000
ReservationId = Annotated[str, Text(64, r"[0-9a-f]{64}", "Transaction id of the ReservePad that made it")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Reservation(Record):
    """One span of time in which a pad is kept for a drone."""

    reservation_id: ReservationId
    uav_id: UavId
    msp_id: MspId
    from_ms: TimeMs
    until_ms: TimeMs
    reserved_by: Name
    reserved_ms: TimeMs

    def validate(self, path: str) -> None:
        """The span must not be empty."""
        if self.until_ms <= self.from_ms:
            raise RecordError(f"{path}.until_ms" if path else "until_ms", "must be after from_ms")

    def overlaps(self, from_ms: int, until_ms: int) -> bool:
        """Whether both want the pad at one time."""
        return self.from_ms < until_ms and from_ms < self.until_ms


@dataclass(frozen=True, kw_only=True, slots=True)
class Reservations(Record):
    """All reservations of a pad, by their beginning. An organisation's new one takes the place of one that is over."""

    pad_id: PadId
    reservations: Annotated[tuple[Reservation, ...], Items(0, MAX_RESERVATIONS)] = ()
