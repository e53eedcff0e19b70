"""Shapes of signing in."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from wonderland_backend.person import Role
from wonderland_backend.schemas import ApiModel


class SignIn(BaseModel):
    """A one-time token that signs in at once, as a demo's start printed it."""

    model_config = ConfigDict(extra="forbid")

    token: str = Field(min_length=1, max_length=128)


class SignedIn(ApiModel):
    """Who is signed in, and until when."""

    person_id: str
    name: str
    roles: list[Role]
    msp_id: str | None = Field(default=None, description="The organisation whose pads or drones are theirs")
    method: Literal["link", "passkey", "oidc", "display"]
    signed_in_ms: int
    expires_ms: int = Field(description="When the sign-in ends in any case")
    idle_s: int = Field(description="Unused by a person for so long, it ends earlier; not so a display's")
