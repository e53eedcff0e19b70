"""Shapes of registration numbers."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from wonderland_backend.schemas import ApiModel


class RegistrationNumber(ApiModel):
    """The operator's registration number, as far as this server has it and this person may see it."""

    state: Literal["none", "here", "elsewhere", "altered"] = Field(
        description="`none`: the drone was registered without one. `elsewhere`: the ledger has a commitment, and this "
        "server nothing that opens it: another organisation holds it, or it was erased. `altered`: what this server "
        "holds does not open the commitment, so somebody changed it; it is not shown"
    )
    number: str | None = Field(default=None, description="In part (FIN---k8) for all but its own organisation")
    held_by: str | None = Field(default=None, description="Elsewhere: the organisation that registered the drone")


class NewNumber(BaseModel):
    """What opens the `registration_commitment` of the argument: kept here, never sent to the ledger."""

    model_config = ConfigDict(extra="forbid", hide_input_in_errors=True)

    registration: str = Field(min_length=1, max_length=32, description="As it was committed to")
    salt: str = Field(pattern="^[0-9a-f]{64}$", description="32 random bytes, lower-case hexadecimal")
