"""Shapes of drones."""

from __future__ import annotations

from pydantic import Field

from backend.schemas import extended, model_of, page_of
from backend.tracks.schemas import Track
from backend.verdicts.schemas import VerdictSummary
from wonderland.proofs.records import uavs

Authorisation = model_of(uavs.Authorisation)
Drone = extended(
    "Drone",
    uavs.Uav,
    "A drone: the ledger's record, its authorisations, its last verdict, and where it says that it is.",
    authorisations=(list[Authorisation], ...),  # type: ignore[valid-type]
    track=(Track | None, Field(default=None, description="Last broadcast position; unverified")),
    verdict=(VerdictSummary | None, Field(default=None, description="The last one")),
)
DronePage = page_of("DronePage", Drone)
