"""Settings of U-space, in the environment as ``WONDERLAND_BACKEND_USPACE__…``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from wonderland_backend.http.addresses import ADDRESS
from wonderland_backend.tokens import IssuerSettings
from wonderland_remote_id.errors import FieldError
from wonderland_remote_id.operators import check_operator_id, public_operator_id


class USpaceSettings(BaseModel):
    """What ties this server to U-space; without `issuers` it serves no other system, without `dss` it seeks none."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    issuers: tuple[IssuerSettings, ...] = Field(default=(), max_length=16, description="Whose tokens are believed")
    audiences: tuple[str, ...] = Field(
        default=(), max_length=8, description="Tokens' `aud`; by default the host name of public_url"
    )
    clock_leeway_s: int = Field(default=10, ge=0, le=60, description="How far others' clocks may be off")

    token_url: str | None = Field(default=None, pattern=f"^{ADDRESS}$", description="Where our own tokens come from")
    client_id: str | None = Field(default=None, min_length=1, max_length=200, description="Our name there")
    client_secret: str | None = Field(
        default=None, min_length=1, repr=False, description="Best given by the environment"
    )
    client_secret_file: Path | None = Field(default=None, description="A file with it, read when it is needed")
    token_request: Literal["audience", "resource", "interuss-dummy"] = Field(
        default="audience",
        description="How the audience is asked for; `interuss-dummy` is the test server of InterUSS",
    )

    dss: tuple[Annotated[str, Field(max_length=300, pattern=f"^{ADDRESS}$")], ...] = Field(
        default=(), max_length=8, description="Instances of the DSS, the preferred one first"
    )
    allowed_hosts: tuple[str, ...] = Field(
        default=(), max_length=64, description="Hosts that may be reached by http or at private addresses: for tests"
    )
    requests_per_min: int = Field(default=3_000, ge=1, description="Most requests of one other system in a minute")

    test_harness: bool = Field(
        default=False, description="Open the interfaces by which InterUSS tests a system: never in production"
    )

    system_identities: tuple[Annotated[str, Field(min_length=1, max_length=200)], ...] = Field(
        default=("gov.eu.uspace.v1.netid", "gov.eu.uspace.v1.geoawareness"),
        max_length=32,
        description="As which systems the test harness tells our version, by the names that the tests use",
    )

    serve: Literal["ours", "heard"] = Field(
        default="ours",
        description="Of which drones we are the service provider: those named by `operators` or `drones` and those"
        " whose own agent is connected here; or every drone that a pad hears, where the law makes us that",
    )
    operators: tuple[str, ...] = Field(
        default=(), max_length=10_000, description="Registrations of operators that have us as their service provider"
    )
    drones: tuple[str, ...] = Field(default=(), max_length=10_000, description="Serial numbers, likewise")

    geoid_file: Path | None = Field(
        default=None, description="EGM96 of 15' (WW15MGH.DAC): without it no heights above mean sea level are told"
    )

    @field_validator("operators")
    @classmethod
    def _public_parts(cls, numbers: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(registration(number) for number in numbers)


def registration(number: str) -> str:
    """The public part of an operator's registration; where it comes with its secret, its check character is checked.

    Raises ValueError.
    """
    try:
        return check_operator_id(number) if "-" in number else public_operator_id(number)
    except FieldError as error:
        raise ValueError(f"{public_operator_id(number)}: {error}") from None
