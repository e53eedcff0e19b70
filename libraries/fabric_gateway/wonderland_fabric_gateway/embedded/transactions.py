"""A submitted transaction: who sends it, and whether its content is what this ledger's peers endorsed.

As on Fabric there are two answers. A sender that may not write, or an envelope that is none, is refused at Submit.
Everything else goes into a block with its validation code: a forged write set has no endorsement over it and becomes
ENDORSEMENT_POLICY_FAILURE there, for all to see. Whose endorsements hold is found out here; whether they are enough
depends on the keys that are written, and is decided with the block.
Source: Fabric ``core/common/validation/msgvalidation.go``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.peer import transaction_pb2

from wonderland_fabric_gateway.embedded.committer import Candidate
from wonderland_fabric_gateway.embedded.errors import AccessDeniedError, MalformedRequestError, ProposalRefusedError
from wonderland_fabric_gateway.embedded.genesis import ABSOLUTE_MAX_BYTES
from wonderland_fabric_gateway.embedded.proposals import proposal_hash, timestamp_ms, transaction_id
from wonderland_fabric_gateway.embedded.rwset import ReadWriteSet, from_accesses
from wonderland_fabric_gateway.errors import BlockError, IdentityError, SignatureError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signing import verify
from wonderland_fabric_gateway.transactions import ValidationCode, parse_invocation

if TYPE_CHECKING:
    from wonderland_fabric_gateway.embedded.endorser import Endorser
    from wonderland_fabric_gateway.embedded.msp import ChannelMembership
    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_gateway.signature_policies import Signer
    from wonderland_fabric_gateway.transactions import Invocation

_EMPTY: Final = ReadWriteSet()


def accept(envelope: Any, endorser: Endorser, membership: ChannelMembership, now_ms: int) -> Candidate:
    """Check a submitted ``common.Envelope`` message and make it ready for a block.

    Raises `MalformedRequestError`, `AccessDeniedError` or `ProposalRefusedError` for what Fabric's orderer refuses.
    """
    data = bytes(envelope.SerializeToString())
    if len(data) > ABSOLUTE_MAX_BYTES:
        raise MalformedRequestError(f"a transaction of {len(data)} bytes; the limit is {ABSOLUTE_MAX_BYTES}")
    payload = _decode(common_pb2.Payload, envelope.payload, "transaction payload")
    channel = _decode(common_pb2.ChannelHeader, payload.header.channel_header, "channel header")
    sender = _decode(common_pb2.SignatureHeader, payload.header.signature_header, "signature header")
    if channel.channel_id != endorser.channel:
        raise ProposalRefusedError(f"channel {channel.channel_id!r} not found; this ledger has {endorser.channel!r}")
    if channel.type != common_pb2.ENDORSER_TRANSACTION:
        raise AccessDeniedError(f"header type {channel.type}: only endorsed transactions can be submitted here")
    if not sender.nonce or not sender.creator:
        raise MalformedRequestError("the signature header lacks nonce or creator")
    membership.application_member(sender.creator, now_ms).verify(envelope.payload, envelope.signature)
    time_ms = timestamp_ms(channel.timestamp)
    tx_id: str = channel.tx_id
    code, rwset, signers = ValidationCode.VALID, endorser.take_prepared(tx_id, envelope.payload), endorser.signers
    if tx_id != transaction_id(sender.nonce, sender.creator):
        code, rwset = ValidationCode.BAD_PROPOSAL_TXID, _EMPTY
    elif rwset is None:
        code, rwset, signers = _check_content(payload, channel, endorser)
    return Candidate(
        tx_id=tx_id,
        envelope=data,
        creator=sender.creator,
        timestamp_ms=time_ms,
        code=int(code),
        config_sequence=membership.sequence,
        rwset=rwset,
        signers=signers,
    )


def _check_content(
    payload: Any, channel: Any, endorser: Endorser
) -> tuple[ValidationCode, ReadWriteSet, tuple[Signer, ...]]:
    """The validation code before any state is looked at, the read-write set, and who signed it."""
    try:
        invocation = parse_invocation(payload.data)
        action = _decode(transaction_pb2.Transaction, payload.data, "transaction").actions[0]
        expected = proposal_hash(payload.header.channel_header, action.header, invocation.proposal_payload)
        if expected != invocation.proposal_hash or action.header != payload.header.signature_header:
            return ValidationCode.INVALID_ENDORSER_TRANSACTION, _EMPTY, ()
        if channel.epoch or not endorser.has_contract(invocation.chaincode):
            return ValidationCode.INVALID_CHAINCODE, _EMPTY, ()
        signers = _signers(invocation, endorser)
        if not signers:
            return ValidationCode.ENDORSEMENT_POLICY_FAILURE, _EMPTY, ()
        return ValidationCode.VALID, from_accesses(invocation.accesses), signers
    except (BlockError, IdentityError, MalformedRequestError):
        return ValidationCode.INVALID_ENDORSER_TRANSACTION, _EMPTY, ()


def _signers(invocation: Invocation, endorser: Endorser) -> tuple[Signer, ...]:
    """Which of this ledger's peers signed this very response. Nobody else's signature counts."""
    given = {(each.endorser.creator, each.signature) for each in invocation.endorsements}
    found = []
    for peer, signer in zip(endorser.peers, endorser.signers, strict=True):
        signed = invocation.response_payload + peer.creator
        if any(_holds(peer, signed, signature) for creator, signature in given if creator == peer.creator):
            found.append(signer)
    return tuple(found)


def _holds(peer: SigningIdentity, message: bytes, signature: bytes) -> bool:
    try:
        verify(peer.identity.public_key, message, signature)
    except SignatureError:
        return False
    return True


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, MalformedRequestError)
