"""Shapes of people, of what they may change about themselves, and of what administrators may change about others."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Annotated, Any, Final, Literal, Self

from fastapi import Path
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from wonderland.problems import Said, said
from wonderland.proofs.records.fields import ID_PATTERN
from wonderland.proofs.records.transactions import ADMIN, MSP_OF_ROLE
from wonderland_backend.field_texts import FieldRefused
from wonderland_backend.person import AUTHORITY, ROLES, Role
from wonderland_backend.schemas import ApiModel

_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069]")
_EMAIL: Final = r"^[^@\s\x00-\x1f]{1,64}@[^@\s\x00-\x1f]+\.[^@\s\x00-\x1f]+$"
OF_AN_ORGANISATION: Final = frozenset({"pad_operator", "fleet_operator"})


def _plain(text: str) -> str:
    text = text.strip()
    if not text or _CONTROL.search(text):
        raise FieldRefused(said("field_name"))
    return text


def _in_order(roles: list[Role]) -> list[Role]:
    return [role for role in ROLES if role in roles]


Name = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_plain)]
Email = Annotated[str, Field(max_length=254, pattern=_EMAIL), AfterValidator(str.lower)]
Roles = Annotated[list[Role], Field(min_length=1, max_length=5), AfterValidator(_in_order)]
MspId = Annotated[str, Field(max_length=64, pattern=f"^({ID_PATTERN})?$")]
Credential = Annotated[dict[str, Any], Field(description="The browser's PublicKeyCredential as JSON")]
Ceremony = Annotated[str, Field(min_length=1, max_length=128)]
PersonIdPath = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]
SignInIdPath = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]
PasskeyIdPath = Annotated[str, Path(pattern="^[A-Za-z0-9_-]{1,1400}$")]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid")


def misfit(roles: Iterable[Role], msp_id: str) -> Said | None:
    """Why these roles are none that this organisation gives; None where they are.

    As on the ledger: administrators and inspectors are the authority's, operators are not.
    """
    of_authority = sorted(set(AUTHORITY).intersection(roles))
    of_operators = sorted(OF_AN_ORGANISATION.intersection(roles))
    authority = MSP_OF_ROLE[ADMIN]
    if of_authority and of_operators:
        return said("roles_of_two", roles=", ".join([*of_authority, *of_operators]))
    if of_authority and msp_id not in {"", authority}:
        return said("role_of_authority", role=of_authority[0], authority=authority, msp_id=msp_id)
    if of_operators and msp_id == authority:
        return said("role_of_operator", role=of_operators[0], authority=authority)
    return None


class Invitation(_Body):
    """Somebody who shall have an account."""

    name: Name
    email: Email | None = Field(default=None, description="By which the OpenID provider's word is matched")
    roles: Roles
    msp_id: MspId = Field(default="", description="The organisation whose pads or drones are theirs")

    @model_validator(mode="after")
    def _of_an_organisation(self) -> Self:
        if not self.msp_id and not OF_AN_ORGANISATION.isdisjoint(self.roles):
            raise FieldRefused(said("fields_operator"))
        if (why := misfit(self.roles, self.msp_id)) is not None:
            raise FieldRefused(why)
        return self


class PersonChange(_Body):
    """What an administrator changes; what is left out stays."""

    revision: int = Field(ge=0, description="The one that you have seen; refused when somebody has changed it since")
    name: Name | None = None
    email: Email | Literal[""] | None = None
    roles: Roles | None = None
    msp_id: MspId | None = None
    state: Literal["active", "suspended"] | None = None


class PersonShown(ApiModel):
    """Somebody who may sign in, or has been invited to."""

    person_id: str
    name: str
    email: str | None = None
    roles: list[Role]
    msp_id: str | None = None
    state: Literal["invited", "active", "suspended"]
    passkeys: int = Field(description="How many they have")
    oidc: bool = Field(description="Whether the OpenID provider vouches for them")
    created_ms: int
    last_seen_ms: int | None = Field(default=None, description="Of the sign-ins that are not over")
    revision: int


class PasskeyShown(ApiModel):
    """A passkey."""

    credential_id: str
    name: str
    created_ms: int
    last_used_ms: int | None = None


class SignInShown(ApiModel):
    """A browser that is signed in."""

    sign_in_id: str
    method: Literal["link", "passkey", "oidc"]
    browser: str = Field(description="What it calls itself (User-Agent)")
    created_ms: int
    last_seen_ms: int
    expires_ms: int
    current: bool = Field(description="Whether it is the one that asks")


class PersonDetail(ApiModel):
    """A person, with how and where they sign in."""

    person: PersonShown
    passkeys: list[PasskeyShown]
    sign_ins: list[SignInShown]


class PeopleList(ApiModel):
    """All people."""

    items: list[PersonShown]


class LinkMade(ApiModel):
    """A link that serves once. It is shown now and never again."""

    person: PersonShown
    token: str = Field(description="Append to the console's address as #token=…")
    expires_ms: int


class NewPasskey(_Body):
    """The browser's answer to the options of a new passkey."""

    ceremony: Ceremony
    credential: Credential
    name: Name = Field(description="What its owner calls it")


class PasskeyName(_Body):
    """Another name for a passkey."""

    name: Name


class Challenge(ApiModel):
    """What to hand to the browser's WebAuthn interface, and what to name with its answer."""

    ceremony: str
    options: dict[str, Any]
