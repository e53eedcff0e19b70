"""The policy of a pad and an action: how sure is sure enough, and how long one may take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.fields import PadId, Ppm
from wonderland.proofs.records.reservations import LONGEST_MS
from wonderland.proofs.records.schema import Choice, Integer, Record

MAX_BUFFER_MM = 100_000
BROADCAST_REQUIRED = ("never", "if_contradicted", "always")


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy(Record):
    """Thresholds of a decision; every field has the default that holds where no policy was set."""

    buffer_mm: Annotated[int, Integer(100, MAX_BUFFER_MM, "Radius around the claim within which the drone must be")] = (
        1_000
    )
    verify_ppm: Ppm = 990_000
    refute_ppm: Ppm = 10_000
    min_assurance: Annotated[int, Integer(0, 4, "Lowest level that can be verified")] = 1
    min_rounds: Annotated[int, Integer(1, 500, "Fewer usable rounds decide nothing")] = 10
    max_rounds: Annotated[int, Integer(1, 500, "The pad stops ranging here")] = 160
    max_claim_age_ms: Annotated[int, Integer(100, 600_000, "Oldest claim that a request may carry")] = 10_000
    max_clock_skew_ms: Annotated[int, Integer(0, 600_000, "Largest difference of clocks that is tolerated")] = 5_000
    session_ttl_ms: Annotated[int, Integer(1_000, 3_600_000, "A session expires after this")] = 60_000
    max_claim_accuracy_mm: Annotated[int, Integer(100, 1_000_000, "A vaguer claim cannot be verified")] = 20_000
    require_authorisation: bool = True
    require_maintenance: bool = True
    min_request_gap_ms: Annotated[
        int, Integer(0, 600_000, "Least time between two requests of one drone to one pad; 0: any")
    ] = 0
    broadcast_required: Annotated[
        str,
        Choice(
            BROADCAST_REQUIRED,
            "When a permission needs a Remote ID message that the measurement supports: never; where somebody's is "
            "contradicted or not settled; always",
        ),
    ] = "if_contradicted"
    height_buffer_mm: Annotated[
        int, Integer(100, MAX_BUFFER_MM, "Above and below the claimed height; proved within, where ranges tell it")
    ] = 1_000
    height_required: bool = False
    """Whether a permission needs a proven height; else it may be the drone's word, while no range speaks against it."""
    cancel_hopeless: bool = False
    """Whether a pad cancels at once what it can settle nothing about; else it ranges ten rounds, for the record."""
    witness_pad_id: PadId | None = None
    """A second pad that time-stamps the same drone in its own signed record; assurance 4 needs one."""
    occupied_ms: (
        Annotated[
            int,
            Integer(1_000, 604_800_000, "A drone that landed keeps the pad until it has left, at most so long"),
        ]
        | None
    ) = None
    """Left out: a landing that is completed leaves the pad free for the next one."""
    reservation_ms: (
        Annotated[int, Integer(60_000, LONGEST_MS, "The longest span of time that is reserved at once")] | None
    ) = None
    """Left out: the pad takes no reservations."""

    def validate(self, path: str) -> None:
        """Thresholds must leave room for a third outcome, and rounds for a look."""
        prefix = f"{path}." if path else ""
        if self.refute_ppm >= self.verify_ppm:
            raise RecordError(f"{prefix}refute_ppm", "must be below verify_ppm")
        if self.max_rounds < self.min_rounds:
            raise RecordError(f"{prefix}max_rounds", "must not be below min_rounds")
