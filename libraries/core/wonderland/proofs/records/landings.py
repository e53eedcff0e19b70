"""Landings that no verdict permitted, as the drone itself reports them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.records.fields import PadId, TimeMs, UavId
from wonderland.proofs.records.schema import Choice, Record
from wonderland.proofs.records.sessions import Claim

LandingCause = Annotated[str, Choice(("pilot", "failsafe", "not_held"))]
"""Who brought it down: its pilot, a fail-safe of its autopilot, or an autopilot that did not obey."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Landing(Record):
    """What the event LandingReported holds; the claim is where the drone says that it stands."""

    uav_id: UavId
    pad_id: PadId
    cause: LandingCause
    claim: Claim
    reported_ms: TimeMs
