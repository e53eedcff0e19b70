"""What the interface shows of authorisations, and how they are asked for."""

from __future__ import annotations

from pydantic import Field

from wonderland.proofs.records.fields import ID_PATTERN
from wonderland_backend.drones.schemas import Authorisation
from wonderland_backend.filters import PageQuery
from wonderland_backend.schemas import page_of

_ID = f"^{ID_PATTERN}$"
AuthorisationPage = page_of("AuthorisationPage", Authorisation)


class AuthorisationQuery(PageQuery):
    """What a list of authorisations is narrowed by."""

    drone: str | None = Field(default=None, pattern=_ID, max_length=40, description="Only of this drone")
    operator: str | None = Field(default=None, pattern=_ID, max_length=64, description="Only of this operator's drones")
    pad: str | None = Field(
        default=None, pattern=_ID, max_length=64, description="Only for this pad; those for every pad count"
    )
    revoked: bool | None = Field(default=None, description="Only revoked ones, or only those that are not")
