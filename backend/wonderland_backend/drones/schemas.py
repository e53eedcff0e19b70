"""Shapes of drones."""

from __future__ import annotations

from pydantic import Field

from wonderland.proofs.records import uavs
from wonderland_backend.numbers.schemas import RegistrationNumber
from wonderland_backend.schemas import extended, model_of, page_of
from wonderland_backend.tracks.schemas import Track
from wonderland_backend.verdicts.schemas import VerdictSummary

Authorisation = model_of(uavs.Authorisation)
Drone = extended(
    "Drone",
    uavs.Uav,
    "A drone: the ledger's record, its operator's number, its authorisations, its last verdict, and its last position "
    "as it says.",
    registration=(RegistrationNumber, ...),
    authorisations=(list[Authorisation], ...),  # type: ignore[valid-type]
    track=(Track | None, Field(default=None, description="Last broadcast position; unverified")),
    verdict=(VerdictSummary | None, Field(default=None, description="The last one")),
)
DronePage = page_of("DronePage", Drone)
