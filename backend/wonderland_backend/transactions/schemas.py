"""Shapes of signing: keys that belong to people, and transactions on their way."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from wonderland_backend.numbers.schemas import NewNumber
from wonderland_backend.schemas import ApiModel

TX_ID = r"^[0-9a-f]{64}$"
MSP_ID = r"^[A-Za-z0-9.-]{1,64}$"
State = Literal["proposed", "endorsed", "submitted", "unknown", "valid", "invalid", "refused", "expired"]
Pem = Annotated[str, Field(min_length=1, max_length=8_192)]
Bytes = Annotated[str, Field(max_length=200_000, pattern=r"^[A-Za-z0-9_-]*$", description="base64url, no padding")]


class Strict(BaseModel):
    """Base of what comes in: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid")


class Seen(Strict):
    """The version of the record that the person has before their eyes."""

    block: int = Field(ge=-1, le=2**53, description="Of the transaction that wrote it; -1: nothing was there")
    tx_index: int = Field(ge=0, le=2**31)


class Propose(Strict):
    """A change that somebody is about to sign."""

    function: str = Field(min_length=1, max_length=32)
    argument: dict[str, Any] = Field(description="As the record of that name; docs/reference/records.md")
    certificate_sha256: str = Field(pattern=TX_ID, description="Of the key that will sign")
    seen: Seen | None = Field(default=None, description="Where the change is of something that is there")
    opening: NewNumber | None = Field(
        default=None, description="Of RegisterUav with a `registration_commitment`: what opens it"
    )


class Signature(Strict):
    """A signature over the bytes that were given to sign."""

    signature: str = Field(
        max_length=100, pattern=r"^[A-Za-z0-9_-]+$", description="ECDSA P-256 SHA-256, DER, low-S; base64url"
    )


class SubmitAgain(Strict):
    """A signature, or none where the signed bytes are here already."""

    signature: str | None = Field(default=None, max_length=100, pattern=r"^[A-Za-z0-9_-]+$")


class SigningProblem(ApiModel):
    """Why a transaction came to nothing."""

    kind: Literal["refused", "changed", "policy", "invalid", "ledger"]
    text: str = Field(description="The contract's or the ledger's own words")
    code: str | None = Field(default=None, description="The contract's code; docs/reference/refusals.md")
    status: int | None = None
    organisations: list[str] | None = Field(default=None, description="Whose peers said so")


class SignedTransaction(ApiModel):
    """A transaction on its way from a form to the ledger."""

    tx_id: str
    function: str
    subject: str
    argument: dict[str, Any]
    state: State
    certificate_sha256: str
    endorsers: list[str] = Field(description="Organisations whose peers have endorsed it")
    to_sign: Bytes | None = Field(default=None, description="What is to be signed now, in states proposed, endorsed")
    block: int | None = None
    validation: str | None = None
    problem: SigningProblem | None = None
    created_ms: int
    changed_ms: int


class SignedTransactions(ApiModel):
    """One's own, newest first."""

    items: list[SignedTransaction]


class SigningKey(ApiModel):
    """A ledger certificate that belongs to the account."""

    certificate_sha256: str
    msp_id: str
    name: str
    role: str
    not_after_ms: int
    certificate: str = Field(description="PEM")
    bound_ms: int
    usable: bool
    problem: str | None = Field(default=None, description="Why the ledger would not take it")


class SigningPlace(ApiModel):
    """What a browser needs to know before it makes a key or signs."""

    channel: str
    chaincode: str
    challenge: str = Field(description="To be signed by a key that is brought along; of this sign-in")
    organisations: list[str] = Field(description="With whose CA one can enrol here")
    demo_roles: list[str] = Field(description="Roles that the demo gives at a click; empty outside of a demo")
    keys: list[SigningKey]


class BringKey(Strict):
    """A certificate whose key is in the browser, and the proof that it is."""

    msp_id: str = Field(pattern=MSP_ID)
    certificate: Pem
    signature: str = Field(max_length=100, pattern=r"^[A-Za-z0-9_-]+$")


class EnrolKey(Strict):
    """A certificate request with the one-time secret of its name (the subject's CN)."""

    msp_id: str = Field(pattern=MSP_ID)
    request: Pem
    secret: str = Field(min_length=1, max_length=256)


class DemoKey(Strict):
    """A certificate request for a role of the demo."""

    role: str = Field(max_length=32)
    request: Pem
