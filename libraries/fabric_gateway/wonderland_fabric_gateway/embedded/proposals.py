"""A client's signed proposal: parsed once, and checked to be what Fabric would let a contract run for.

Source: Fabric ``core/endorser/msgvalidation.go`` (headers, transaction id, creator, signature) and, for the time
window, ``common/deliver``; the window holds for proposals, too, since the contract judges freshness by that clock.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2

from wonderland_fabric_gateway.embedded.errors import AccessDeniedError, MalformedRequestError, ProposalRefusedError
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from wonderland_fabric_gateway.embedded.msp import ChannelMembership, Member

MAX_PROPOSAL_BYTES: Final = 4 << 20
MAX_NONCE_BYTES: Final = 1024
TIME_WINDOW_MS: Final = 15 * 60 * 1000
MAX_TIMESTAMP_S: Final = 253_402_300_799


@dataclass(frozen=True, slots=True)
class Proposal:
    """A parsed proposal. `args` includes the function's name first, as Fabric sends it."""

    channel: str
    tx_id: str
    timestamp_ms: int
    creator: bytes
    chaincode: str
    args: tuple[bytes, ...]
    channel_header: bytes
    signature_header: bytes
    payload: bytes
    """``ChaincodeProposalPayload`` without transient data: what goes into the transaction."""
    signed: bytes
    signature: bytes
    nonce: bytes

    @property
    def hash(self) -> bytes:
        """SHA-256(channel header ‖ signature header ‖ payload): what the endorsement refers to."""
        return proposal_hash(self.channel_header, self.signature_header, self.payload)


def proposal_hash(channel_header: bytes, signature_header: bytes, payload: bytes) -> bytes:
    """Fabric's proposal hash; `payload` is the ``ChaincodeProposalPayload`` without transient data."""
    digest = hashlib.sha256(channel_header)
    digest.update(signature_header)
    digest.update(payload)
    return digest.digest()


def transaction_id(nonce: bytes, creator: bytes) -> str:
    """Lower-case hex SHA-256(nonce ‖ creator)."""
    return hashlib.sha256(nonce + creator).hexdigest()


def parse_proposal(signed_proposal: Any) -> Proposal:
    """Read a ``peer.SignedProposal`` message. Raises `MalformedRequestError`."""
    data: bytes = signed_proposal.proposal_bytes
    if not data:
        raise MalformedRequestError("the proposed transaction must contain a signed proposal")
    if len(data) > MAX_PROPOSAL_BYTES:
        raise MalformedRequestError(f"a proposal of {len(data)} bytes; the limit is {MAX_PROPOSAL_BYTES}")
    proposal = _decode(proposal_pb2.Proposal, data, "proposal")
    header = _decode(common_pb2.Header, proposal.header, "header")
    channel = _decode(common_pb2.ChannelHeader, header.channel_header, "channel header")
    sender = _decode(common_pb2.SignatureHeader, header.signature_header, "signature header")
    extension = _decode(proposal_pb2.ChaincodeHeaderExtension, channel.extension, "chaincode header extension")
    payload = _decode(proposal_pb2.ChaincodeProposalPayload, proposal.payload, "proposal payload")
    spec = _decode(chaincode_pb2.ChaincodeInvocationSpec, payload.input, "invocation").chaincode_spec
    if channel.type != common_pb2.ENDORSER_TRANSACTION:
        raise MalformedRequestError(f"header type {channel.type} is not that of a proposal")
    if channel.epoch:
        raise MalformedRequestError("the header's epoch is not 0")
    if not 0 < len(sender.nonce) <= MAX_NONCE_BYTES:
        raise MalformedRequestError(f"a nonce of {len(sender.nonce)} bytes; it takes 1 to {MAX_NONCE_BYTES}")
    if not sender.creator:
        raise MalformedRequestError("the signature header names no creator")
    name = extension.chaincode_id.name
    if not name or name != spec.chaincode_id.name:
        raise MalformedRequestError("header and invocation must name the same chaincode")
    kept = proposal.payload
    if payload.TransientMap:
        kept = proposal_pb2.ChaincodeProposalPayload(input=payload.input).SerializeToString()
    return Proposal(
        channel=channel.channel_id,
        tx_id=channel.tx_id,
        timestamp_ms=timestamp_ms(channel.timestamp),
        creator=sender.creator,
        chaincode=name,
        args=tuple(spec.input.args),
        channel_header=header.channel_header,
        signature_header=header.signature_header,
        payload=kept,
        signed=data,
        signature=signed_proposal.signature,
        nonce=sender.nonce,
    )


def timestamp_ms(timestamp: Any) -> int:
    """Milliseconds since the epoch of a protocol-buffer Timestamp. Raises `MalformedRequestError`."""
    if not (0 < timestamp.seconds <= MAX_TIMESTAMP_S and 0 <= timestamp.nanos < 1_000_000_000):
        raise MalformedRequestError(f"a header timestamp of {timestamp.seconds} s, {timestamp.nanos} ns is no time")
    return int(timestamp.seconds) * 1000 + int(timestamp.nanos) // 1_000_000


def require_recent(time_ms: int, now_ms: int) -> None:
    """Raise `ProposalRefusedError` unless `time_ms` is within 15 minutes of `now_ms`."""
    if abs(time_ms - now_ms) > TIME_WINDOW_MS:
        raise ProposalRefusedError(
            f"the timestamp is {abs(time_ms - now_ms) // 1000} s {'behind' if time_ms < now_ms else 'ahead of'} the "
            "ledger's clock, more than 15 minutes; set this machine's clock"
        )


def check_proposal(proposal: Proposal, channel: str, membership: ChannelMembership, now_ms: int) -> Member:
    """Who sent it, after every check that needs no ledger state.

    Raises `ProposalRefusedError` or `AccessDeniedError`. Whether the transaction id is new is the caller's to check.
    """
    if proposal.channel != channel:
        raise ProposalRefusedError(f"channel {proposal.channel!r} not found; this ledger has {channel!r}")
    expected = transaction_id(proposal.nonce, proposal.creator)
    if proposal.tx_id != expected:
        raise ProposalRefusedError(f"incorrectly computed txid {proposal.tx_id[:80]!r} -- expected {expected!r}")
    try:
        member = membership.application_member(proposal.creator, now_ms)
        member.verify(proposal.signed, proposal.signature)
    except AccessDeniedError as cause:
        raise AccessDeniedError(f"access denied: channel [{channel}]: {cause}") from cause
    require_recent(proposal.timestamp_ms, now_ms)
    return member


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, MalformedRequestError)
