"""Shapes of signing in."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from backend.schemas import ApiModel


class SignIn(BaseModel):
    """A one-time token, as the server's start printed it."""

    model_config = ConfigDict(extra="forbid")

    token: str = Field(min_length=1, max_length=128)


class SignedIn(ApiModel):
    """Who is signed in, and until when."""

    name: str
    roles: list[str]
    method: Literal["one_time_token"]
    signed_in_ms: int
    expires_ms: int
