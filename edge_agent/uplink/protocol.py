"""The agent's side of ``wonderland-ingest/1`` (docs/seams.md), without I/O: texts in, events out.

challenge → hello (signed with the ledger identity) → welcome, which says from where to go on → records and cumulative
acknowledgements. One `UplinkProtocol` is one connection.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from edge_agent.uplink.errors import UplinkError, UplinkProtocolError
from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from edge_agent.spool import StoredRecord

PROTOCOL: Final = "wonderland-ingest/1"
PURPOSE: Final = "wonderland-ingest"
SERVER: Final = "wonderland"
NONCE_BYTES: Final = 32
MAX_FRAME_BYTES: Final = 256 * 1024
MAX_SERVER_FRAME_BYTES: Final = 64 * 1024
MAX_TEXT_CHARS: Final = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Credentials:
    """Who this agent is. ``sign`` maps a message to a DER low-S ECDSA P-256/SHA-256 signature with the ledger key."""

    agent: str
    id: str
    msp_id: str
    certificate_pem: str
    sign: Callable[[bytes], bytes]


@dataclass(frozen=True, slots=True)
class SendHello:
    """The answer to the challenge: send this text."""

    text: str


@dataclass(frozen=True, slots=True)
class Welcomed:
    """The server knows this agent, and holds everything up to ``acknowledged``."""

    acknowledged: int


@dataclass(frozen=True, slots=True)
class Refused:
    """The server does not let this agent in, and closes."""

    code: str
    message: str


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """The server holds everything up to ``seq`` durably."""

    seq: int


@dataclass(frozen=True, slots=True)
class Rejected:
    """The server keeps this record as one that it could not read; it stays acknowledged with the others."""

    seq: int
    code: str
    message: str


Event: TypeAlias = SendHello | Welcomed | Refused | Acknowledged | Rejected


class State(enum.Enum):
    """Where a connection stands."""

    CHALLENGE = "waiting for the challenge"
    WELCOME = "waiting for the welcome"
    STREAMING = "streaming"
    REFUSED = "refused"


class UplinkProtocol:
    """The order of messages on one connection, and what is under way on it."""

    def __init__(self, credentials: Credentials, spool: str) -> None:
        self._credentials = credentials
        self._spool = spool
        self.state = State.CHALLENGE
        self.sent_seq = 0
        """Number of the last record sent on this connection (or welcomed)."""
        self.acknowledged_seq = 0
        """Number up to which the server holds everything."""

    def receive(self, text: str | bytes) -> Event:
        """What a text of the server means. Raises `UplinkProtocolError`."""
        message = _decoded(text)
        kind = _text(message, "type")
        if self.state is State.CHALLENGE and kind == "challenge":
            return self._challenged(message)
        if self.state in {State.CHALLENGE, State.WELCOME} and kind == "refused":
            self.state = State.REFUSED
            return Refused(_text(message, "code"), _text(message, "message", ""))
        if self.state is State.WELCOME and kind == "welcome":
            self.state = State.STREAMING
            self.acknowledged_seq = self.sent_seq = _number(message, "acknowledged")
            return Welcomed(self.acknowledged_seq)
        if self.state is State.STREAMING and kind == "ack":
            return self._acknowledged(_number(message, "seq"))
        if self.state is State.STREAMING and kind == "rejected":
            return Rejected(_number(message, "seq"), _text(message, "code"), _text(message, "message", ""))
        if self.state is State.STREAMING and kind == "refused":
            self.state = State.REFUSED
            return Refused(_text(message, "code"), _text(message, "message", ""))
        raise UplinkProtocolError(f"the server sent {kind[:40]!r} while the agent was {self.state.value}")

    def records(self, records: Sequence[StoredRecord]) -> str:
        """The text that carries records, in order and after those already sent. Raises `UplinkProtocolError`."""
        if self.state is not State.STREAMING:
            raise UplinkProtocolError(f"records cannot be sent while {self.state.value}")
        seq = self.sent_seq
        parts = []
        for record in records:
            if record.seq <= seq:
                raise UplinkProtocolError(f"record {record.seq} would follow record {seq}")
            seq = record.seq
            # The body is canonical JSON already; a kind has no character that JSON would escape.
            parts.append(f'{{"body":{record.body.decode()},"kind":"{record.kind}","seq":{seq},"t_ms":{record.t_ms}}}')
        text = f'{{"records":[{",".join(parts)}],"type":"records"}}'
        if len(text) > MAX_FRAME_BYTES // 3 and len(text.encode()) > MAX_FRAME_BYTES:
            raise UplinkProtocolError(f"{len(records)} records need more than {MAX_FRAME_BYTES} bytes; send fewer")
        self.sent_seq = seq
        return text

    def _challenged(self, message: dict[str, Any]) -> SendHello:
        nonce, server = _text(message, "nonce"), _text(message, "server")
        try:
            size = len(encoding.from_base64url(nonce))
        except EncodingError as cause:
            raise UplinkProtocolError(f"the server's nonce: {cause}") from cause
        if size != NONCE_BYTES:
            raise UplinkProtocolError(f"the server's nonce has {size} bytes, not {NONCE_BYTES}")
        if server != SERVER:
            raise UplinkProtocolError(f"the server calls itself {server[:40]!r}, not {SERVER!r}: is the address right?")
        who = self._credentials
        signed = challenge_bytes(nonce=nonce, server=server, agent=who.agent, agent_id=who.id, spool=self._spool)
        try:
            signature = who.sign(signed)
        except Exception as cause:
            raise UplinkError(f"the ledger key cannot sign ({cause})") from cause  # a signer is anybody's function
        hello = {
            "type": "hello",
            "protocol": PROTOCOL,
            "agent": who.agent,
            "id": who.id,
            "spool": self._spool,
            "msp_id": who.msp_id,
            "certificate": who.certificate_pem,
            "signature": encoding.to_base64url(signature),
        }
        self.state = State.WELCOME
        return SendHello(encoding.encode(hello).decode())

    def _acknowledged(self, seq: int) -> Acknowledged:
        if seq > self.sent_seq:
            raise UplinkProtocolError(f"the server acknowledged {seq}, but the last record sent is {self.sent_seq}")
        if seq < self.acknowledged_seq:
            raise UplinkProtocolError(f"the server went back from {self.acknowledged_seq} to {seq}")
        self.acknowledged_seq = seq
        return Acknowledged(seq)


def challenge_bytes(*, nonce: str, server: str, agent: str, agent_id: str, spool: str) -> bytes:
    """What an agent signs: canonical JSON that names its purpose, so that it can never pass for something else."""
    return encoding.encode(
        {"purpose": PURPOSE, "nonce": nonce, "server": server, "agent": agent, "id": agent_id, "spool": spool}
    )


def _decoded(text: str | bytes) -> dict[str, Any]:
    try:
        message = encoding.decode(text, max_bytes=MAX_SERVER_FRAME_BYTES)
    except EncodingError as cause:
        raise UplinkProtocolError(f"the server's message: {cause}") from cause
    if not isinstance(message, dict):
        raise UplinkProtocolError("the server's message is no JSON object")
    return message


def _text(message: dict[str, Any], name: str, default: str | None = None) -> str:
    value = message.get(name, default)
    if not isinstance(value, str):
        raise UplinkProtocolError(f"the server's message has no text {name!r}")
    return value[:MAX_TEXT_CHARS]


def _number(message: dict[str, Any], name: str) -> int:
    value = message.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise UplinkProtocolError(f"the server's message has no number {name!r} from 0 on")
    return value
