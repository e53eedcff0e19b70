"""The messages of ``wonderland-ingest/1``: one JSON text each, tagged by ``type``.

Server: challenge. Agent: hello, signed with its ledger identity. Server: welcome, or refused. Agent: records, and a
drone answers; server: ack, rejected, please_prove.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta, Raw, Struct

from wonderland.proofs import encoding
from wonderland.telemetry.fields import (
    MAX_SEQ,
    Action,
    AgentId,
    Base64url,
    EndPoint,
    Hex32,
    Message,
    MspId,
    PadId,
    Seq,
    Text32,
    Text300,
    TimeMs,
    said,
)

PROTOCOL: Final = "wonderland-ingest/1"
PURPOSE: Final = "wonderland-ingest"
SERVER: Final = "wonderland"
NONCE_BYTES: Final = 32

_Held = Annotated[int, Meta(ge=0, le=MAX_SEQ, description="Highest number that the server holds durably")]
_Code = Annotated[str, Meta(description="For machines")]


class _FromServer(Struct, frozen=True, kw_only=True, tag_field="type"):
    """Base of what the server says: a later one may say more in it, which is passed over."""


class Challenge(_FromServer, frozen=True, kw_only=True, tag="challenge"):
    """The server's first message."""

    nonce: Annotated[str, Meta(description="Base64url of 32 bytes")]
    server: Annotated[str, Meta(description="`wonderland`")]
    t_ms: Annotated[TimeMs, Meta(description="The server's time")] = 0


class Welcome(_FromServer, frozen=True, kw_only=True, tag="welcome"):
    """The agent is known; go on after `acknowledged`."""

    acknowledged: _Held


class Refused(_FromServer, frozen=True, kw_only=True, tag="refused"):
    """The agent is not let in, or sent a frame that is none; the connection is closed."""

    code: _Code
    message: str = ""


class Ack(_FromServer, frozen=True, kw_only=True, tag="ack"):
    """Everything up to `seq` is held durably, or was rejected for good."""

    seq: _Held


class Rejected(_FromServer, frozen=True, kw_only=True, tag="rejected"):
    """One record that could not be used; it is kept as such and acknowledged with the others."""

    seq: Annotated[int, Meta(ge=0, le=MAX_SEQ, description="Its number")]
    code: _Code
    message: str = ""


class PleaseProve(_FromServer, frozen=True, kw_only=True, tag="please_prove"):
    """Somebody asks that this drone proves itself at a pad: a wish, no command. To drones that take it."""

    request_id: Hex32
    pad_id: PadId
    action: Action
    expires_ms: TimeMs


class Hello(Message, frozen=True, kw_only=True, tag_field="type", tag="hello"):
    """Who an agent is, and the proof that it holds its ledger key."""

    protocol: Literal["wonderland-ingest/1"]
    agent: Literal["pad", "uav"]
    id: AgentId
    spool: Hex32
    msp_id: MspId
    certificate: Annotated[str, Meta(min_length=1, max_length=16_384, description="PEM")]
    tls_server_end_point: Annotated[
        EndPoint,
        Meta(description="Hexadecimal SHA-256 of the certificate (DER) that the server showed; empty without TLS"),
    ]
    signature: Annotated[Base64url, Meta(description="Base64url of the DER of a low-S ECDSA P-256 signature, SHA-256")]
    takes: Annotated[
        tuple[Literal["please_prove"], ...],
        Meta(max_length=1, description="Messages besides those of the protocol's beginning that the agent understands"),
    ] = ()


class Records(Message, frozen=True, kw_only=True, tag_field="type", tag="records"):
    """A batch of a spool's records, in order."""

    records: Annotated[list[Raw], Meta(description="Each a Record; a bad one is rejected alone")]


class Answer(Message, frozen=True, kw_only=True, tag_field="type", tag="answer"):
    """Whether a drone's agent will do what it was asked (`please_prove`)."""

    request_id: Hex32
    accepted: bool
    text: Annotated[Text300, Meta(description="Why not")] = said("")


class Record(Message, frozen=True, kw_only=True):
    """One record of a spool, its body not looked at yet."""

    seq: Seq
    kind: Text32
    t_ms: TimeMs
    body: Annotated[Raw, Meta(description="An object, as `kind` says")]


FromAgent = Hello | Records | Answer
FromServer = Challenge | Welcome | Refused | Ack | Rejected | PleaseProve


def signed_text(*, nonce: str, agent: str, agent_id: str, spool: str, end_point: str) -> bytes:
    """What an agent signs: bound to this server's nonce and certificate, so that it serves once and nowhere else."""
    return encoding.encode(
        {
            "purpose": PURPOSE,
            "nonce": nonce,
            "server": SERVER,
            "agent": agent,
            "id": agent_id,
            "spool": spool,
            "tls_server_end_point": end_point,
        }
    )
