"""Settings of signing in by OpenID Connect, in the environment as ``WONDERLAND_BACKEND_OIDC__…``."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from wonderland_backend.person import ROLES, Role

ADDRESS: Final = r"^(https://[^/\s@?#]+|http://(localhost|127\.0\.0\.1)(:\d+)?)(/[^\s@?#]*)?$"


class OidcSettings(BaseModel):
    """An OpenID provider that says who people are. Without `issuer` there is none."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    issuer: str | None = Field(default=None, max_length=500, pattern=ADDRESS, description="Exactly as its tokens say")
    client_id: str = Field(default="", max_length=200, description="This console's name at the provider")
    client_secret: str | None = Field(default=None, min_length=1, description="Best given by the environment")
    client_secret_file: Path | None = Field(default=None, description="A file with it, read when it is needed")
    name: str = Field(default="single sign-on", min_length=1, max_length=60, description="What the button calls it")
    scopes: str = Field(
        default="openid email profile", pattern=r"^openid( [!-~]+)*$", max_length=300, description="What is asked for"
    )
    acr: tuple[str, ...] = Field(
        default=(), max_length=16, description="How strongly somebody must have signed in there: one of these `acr`"
    )
    groups_claim: str = Field(
        default="groups", min_length=1, max_length=100, description="In which claim the provider says one's groups"
    )
    roles: dict[str, Role] = Field(
        default={}, description="Roles by group; then the provider's groups say at each sign-in which roles one has"
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.issuer is not None and not self.client_id:
            raise ValueError("oidc.issuer needs oidc.client_id")
        return self

    def secret(self) -> str | None:
        """The client's secret; None for a public client, or where its file cannot be read."""
        if self.client_secret_file is None:
            return self.client_secret
        try:
            return self.client_secret_file.read_text().strip() or None
        except (OSError, UnicodeDecodeError):
            return None

    def roles_of(self, claims: dict[str, object]) -> tuple[Role, ...] | None:
        """The roles that the provider's groups give; None where it has no say."""
        if not self.roles:
            return None
        groups = claims.get(self.groups_claim)
        named = groups if isinstance(groups, list) else [groups]
        given = {self.roles[each] for each in named if isinstance(each, str) and each in self.roles}
        return tuple(role for role in ROLES if role in given)
