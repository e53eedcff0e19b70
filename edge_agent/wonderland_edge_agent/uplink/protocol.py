"""The agent's side of ``wonderland-ingest/1`` (`wonderland.telemetry`), without I/O: texts in, events out.

challenge → hello (signed with the ledger identity) → welcome, which says from where to go on → records and cumulative
acknowledgements. One `UplinkProtocol` is one connection.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

from msgspec import Raw

from wonderland import telemetry
from wonderland.telemetry import (
    NO_END_POINT,
    Ack,
    Challenge,
    Credentials,
    Record,
    Refused,
    Rejected,
    TelemetryError,
    Welcome,
    hello_to,
)
from wonderland_edge_agent.uplink.errors import UplinkError, UplinkProtocolError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland.telemetry.frames import FromServer
    from wonderland_edge_agent.spool import StoredRecord

MAX_FRAME_BYTES: Final = 256 * 1024
MAX_SERVER_FRAME_BYTES: Final = 64 * 1024
MAX_TEXT_CHARS: Final = 500


@dataclass(frozen=True, slots=True)
class SendHello:
    """The answer to the challenge: send this text."""

    text: str


Event: TypeAlias = SendHello | Welcome | Refused | Ack | Rejected


class State(enum.Enum):
    """Where a connection stands."""

    CHALLENGE = "waiting for the challenge"
    WELCOME = "waiting for the welcome"
    STREAMING = "streaming"
    REFUSED = "refused"


class UplinkProtocol:
    """The order of messages on one connection, and what is under way on it."""

    def __init__(self, credentials: Credentials, spool: str, end_point: str = NO_END_POINT) -> None:
        """`end_point`: of the server's certificate (`telemetry.end_point_seen`)."""
        self._credentials = credentials
        self._end_point = end_point
        self._spool = spool
        self.state = State.CHALLENGE
        self.sent_seq = 0
        """Number of the last record sent on this connection (or welcomed)."""
        self.acknowledged_seq = 0
        """Number up to which the server holds everything."""

    def receive(self, text: str | bytes) -> Event:
        """What a text of the server means. Raises `UplinkProtocolError`."""
        match self.state, _decoded(text):
            case State.CHALLENGE, Challenge() as challenge:
                return self._challenged(challenge)
            case State.CHALLENGE | State.WELCOME | State.STREAMING, Refused() as refused:
                self.state = State.REFUSED
                return Refused(code=_text(refused.code), message=_text(refused.message))
            case State.WELCOME, Welcome() as welcome:
                self.state = State.STREAMING
                self.acknowledged_seq = self.sent_seq = welcome.acknowledged
                return welcome
            case State.STREAMING, Ack() as ack:
                return self._acknowledged(ack)
            case State.STREAMING, Rejected() as rejected:
                return Rejected(seq=rejected.seq, code=_text(rejected.code), message=_text(rejected.message))
            case _, other:
                said = other.__struct_config__.tag
                raise UplinkProtocolError(f"the server sent {said!r} while the agent was {self.state.value}")

    def records(self, records: Sequence[StoredRecord]) -> str:
        """The text that carries records, in order and after those already sent. Raises `UplinkProtocolError`."""
        if self.state is not State.STREAMING:
            raise UplinkProtocolError(f"records cannot be sent while {self.state.value}")
        seq = self.sent_seq
        numbered = []
        for record in records:
            if record.seq <= seq:
                raise UplinkProtocolError(f"record {record.seq} would follow record {seq}")
            seq = record.seq
            numbered.append(Record(seq=seq, kind=record.kind, t_ms=record.t_ms, body=Raw(record.body)))
        frame = telemetry.canonical(telemetry.records_of(numbered))
        if len(frame) > MAX_FRAME_BYTES:
            raise UplinkProtocolError(f"{len(records)} records need more than {MAX_FRAME_BYTES} bytes; send fewer")
        self.sent_seq = seq
        return frame.decode()

    def _challenged(self, challenge: Challenge) -> SendHello:
        try:
            hello = hello_to(challenge, self._credentials, spool=self._spool, end_point=self._end_point)
        except TelemetryError as cause:
            raise UplinkProtocolError(str(cause)) from cause
        except Exception as cause:
            raise UplinkError(f"the ledger key cannot sign ({cause})") from cause  # a signer is anybody's function
        self.state = State.WELCOME
        return SendHello(telemetry.canonical(hello).decode())

    def _acknowledged(self, ack: Ack) -> Ack:
        if ack.seq > self.sent_seq:
            raise UplinkProtocolError(f"the server acknowledged {ack.seq}, but the last record sent is {self.sent_seq}")
        if ack.seq < self.acknowledged_seq:
            raise UplinkProtocolError(f"the server went back from {self.acknowledged_seq} to {ack.seq}")
        self.acknowledged_seq = ack.seq
        return ack


def _text(said: str) -> str:
    """A text of the server's as it can be logged."""
    return telemetry.clean(said, MAX_TEXT_CHARS)


def _decoded(text: str | bytes) -> FromServer:
    if len(text) > MAX_SERVER_FRAME_BYTES:
        raise UplinkProtocolError(f"the server's message: more than {MAX_SERVER_FRAME_BYTES} bytes")
    try:
        return telemetry.decode_server(text)
    except TelemetryError as cause:
        raise UplinkProtocolError(f"the server's message: {cause}") from cause
