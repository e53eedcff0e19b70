"""A transaction by itself: who sent it, that nothing in it was exchanged, and which peers endorsed what it did.

Source: Fabric ``core/common/validation/msgvalidation.go``, ``core/handlers/validation``. What cannot be seen in a
transaction is whether it was valid: that depends on all before it, and is nobody's signature in a block.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.common import common_pb2
from fabric_protos.peer import policy_pb2, proposal_pb2, transaction_pb2

from wonderland_fabric_gateway.errors import BlockError, LedgerError, SignatureError, VerificationError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signature_policies import PEER, satisfied
from wonderland_fabric_gateway.signing import verify
from wonderland_fabric_gateway.transactions import Transaction, TransactionType, parse_transaction
from wonderland_fabric_gateway.verification.channel_trust import APPLICATION, ChannelTrust, signer_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland_fabric_gateway.embedded.msp import Member
    from wonderland_fabric_gateway.signature_policies import Signer
    from wonderland_fabric_gateway.transactions import Endorsement, Invocation

_VALID: Final = 0


@dataclass(frozen=True)
class SignedTransaction:
    """A parsed transaction with the very bytes that its signatures and hashes are over."""

    parsed: Transaction
    payload: bytes
    channel_header: bytes
    signature_header: bytes
    action_header: bytes
    has_epoch: bool

    @classmethod
    def read(cls, envelope: bytes, index: int = 0) -> SignedTransaction:
        """Parse an envelope of a block. Raises `BlockError` for anything but a whole, endorsed transaction."""
        return cls.of(parse_transaction(envelope, index, _VALID), envelope)

    @classmethod
    def of(cls, parsed: Transaction, envelope: bytes) -> SignedTransaction:
        """The same of one that is parsed already."""
        if parsed.type is not TransactionType.ENDORSER:
            raise BlockError(f"a transaction of type {parsed.type}, not an endorsed one")
        outer = decode(common_pb2.Envelope, envelope, "envelope", BlockError)
        payload = decode(common_pb2.Payload, outer.payload, "payload", BlockError)
        header = decode(common_pb2.ChannelHeader, payload.header.channel_header, "channel header", BlockError)
        action = decode(transaction_pb2.Transaction, payload.data, "transaction", BlockError).actions[0]
        return cls(
            parsed=parsed,
            payload=outer.payload,
            channel_header=payload.header.channel_header,
            signature_header=payload.header.signature_header,
            action_header=action.header,
            has_epoch=bool(header.epoch),
        )

    @property
    def invocation(self) -> Invocation:
        """What the contract did."""
        assert self.parsed.invocation is not None  # `read` has seen to it
        return self.parsed.invocation


def check_sender(trust: ChannelTrust, transaction: SignedTransaction) -> Member:
    """Who sent it: signature, certificate at its own time, id, channel, headers. Raises `VerificationError`."""
    parsed = transaction.parsed
    assert parsed.creator is not None
    if parsed.channel != trust.channel:
        raise VerificationError(f"it is of channel {parsed.channel!r}, not {trust.channel!r}")
    member = trust.member(parsed.creator.creator, parsed.timestamp_ms, APPLICATION)
    try:
        verify(parsed.creator.public_key, transaction.payload, parsed.signature)
    except SignatureError as cause:
        raise VerificationError(f"the sender’s signature: {cause}") from cause
    if parsed.tx_id != hashlib.sha256(parsed.nonce + parsed.creator.creator).hexdigest():
        raise VerificationError("its id is not the hash of its nonce and its sender")
    if transaction.action_header != transaction.signature_header or transaction.has_epoch:
        raise VerificationError("its headers contradict one another")
    return member


def check_proposal(transaction: SignedTransaction) -> None:
    """What was endorsed is the answer to what was proposed here, to the contract named here.

    Raises `VerificationError`.
    """
    invocation = transaction.invocation
    expected = proposal_hash(transaction.channel_header, transaction.signature_header, invocation.proposal_payload)
    if expected != invocation.proposal_hash:
        raise VerificationError("the endorsed response belongs to another proposal")
    header = decode(common_pb2.ChannelHeader, transaction.channel_header, "channel header", BlockError)
    extension = decode(proposal_pb2.ChaincodeHeaderExtension, header.extension, "header extension", BlockError)
    if extension.chaincode_id.name != invocation.chaincode:
        raise VerificationError("proposed to one contract, answered by another")


def proposal_hash(channel_header: bytes, signature_header: bytes, payload: bytes) -> bytes:
    """SHA-256 over the three parts of a proposal: what its responses refer to."""
    return hashlib.sha256(channel_header + signature_header + payload).digest()


def endorsers(trust: ChannelTrust, invocation: Invocation, at_ms: int) -> tuple[Signer, ...]:
    """The peers that endorsed, every signature verified (low-S). Raises `VerificationError`."""
    return tuple(_endorser(trust, invocation, each, at_ms) for each in invocation.endorsements)


def counted_endorsers(trust: ChannelTrust, invocation: Invocation, at_ms: int) -> tuple[Signer, ...]:
    """Those of them that count, as peers count them: a sender may add one that does not hold, and gains nothing."""
    found: list[Signer] = []
    for each in invocation.endorsements:
        with suppress(VerificationError):
            found.append(_endorser(trust, invocation, each, at_ms))
    return tuple(found)


def _endorser(trust: ChannelTrust, invocation: Invocation, each: Endorsement, at_ms: int) -> Signer:
    creator = each.endorser.creator
    member = trust.member(creator, at_ms, APPLICATION)
    try:
        verify(each.endorser.public_key, invocation.response_payload + creator, each.signature)
    except SignatureError as cause:
        raise VerificationError(f"an endorsement of {member.creator.msp_id}: {cause}") from cause
    if member.creator.node_ou.upper() != PEER:
        raise VerificationError(f"{member.creator.common_name} of {member.creator.msp_id} endorsed, and is no peer")
    return signer_of(member)


def policy_holds(trust: ChannelTrust, application_policy: bytes, signers: Sequence[Signer]) -> bool:
    """Whether endorsements meet a contract's policy (``peer.ApplicationPolicy``). Raises `LedgerError`."""
    policy = decode(policy_pb2.ApplicationPolicy, application_policy, "endorsement policy", BlockError)
    kind = policy.WhichOneof("Type")
    if kind == "signature_policy":
        return satisfied(policy.signature_policy, signers)
    if kind == "channel_config_policy_reference":
        return trust.holds_at(policy.channel_config_policy_reference, signers)
    raise LedgerError("an endorsement policy of a kind that is not known")
