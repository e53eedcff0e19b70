"""Stage one: a proposal, which asks peers to run a function of a contract."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2

from wonderland_fabric_gateway.gateway.errors import EndorseError, MalformedError
from wonderland_fabric_gateway.gateway.transaction import Transaction
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wonderland_fabric_gateway.gateway.calls import Environment

_NONCE_BYTES: Final = 24


class Proposal:
    """A proposal, signed or not yet. To sign offline: pass `message` to the key, give the result to `signed`."""

    def __init__(self, environment: Environment, proposed: Any) -> None:
        self._environment = environment
        self._proposed = proposed  # gateway.ProposedTransaction
        self._header = _header(proposed.proposal.proposal_bytes)
        self._channel = decode(
            common_pb2.ChannelHeader, self._header.channel_header, "proposal: channel header", MalformedError
        ).channel_id

    @classmethod
    def from_bytes(cls, environment: Environment, data: bytes) -> Proposal:
        """A proposal from `to_bytes`, also of another client. Raises `MalformedError`."""
        proposed = decode(gateway_pb2.ProposedTransaction, data, "proposal", MalformedError)
        if not proposed.transaction_id or not proposed.proposal.proposal_bytes:
            raise MalformedError("proposal: it has no transaction id, or nothing is proposed")
        return cls(environment, proposed)

    @property
    def tx_id(self) -> str:
        """The transaction id: hex SHA-256 over nonce ‖ creator. It is known before anything is sent."""
        return str(self._proposed.transaction_id)

    @property
    def message(self) -> bytes:
        """What is to be signed (ECDSA P-256 over SHA-256 of it, DER, low-S)."""
        return bytes(self._proposed.proposal.proposal_bytes)

    @property
    def digest(self) -> bytes:
        """SHA-256 of `message`, for signers that take a digest."""
        return hashlib.sha256(self.message).digest()

    def to_bytes(self) -> bytes:
        """``gateway.ProposedTransaction``, to be signed elsewhere or later."""
        return bytes(self._proposed.SerializeToString())

    def signed(self, signature: bytes) -> Proposal:
        """The same proposal with that signature."""
        copy = gateway_pb2.ProposedTransaction()
        copy.CopyFrom(self._proposed)
        copy.proposal.signature = signature
        return Proposal(self._environment, copy)

    async def evaluate(self, *, timeout_s: float | None = None) -> bytes:
        """Run it on one peer, as a query; nothing is recorded. Raises `EvaluateError`, `UnsignedError`."""
        request = gateway_pb2.EvaluateRequest(
            transaction_id=self.tx_id,
            channel_id=self._channel,
            proposed_transaction=self._signed_proposal(),
            target_organizations=self._proposed.endorsing_organizations,
        )
        answer = await self._environment.calls.evaluate(request, self.tx_id, timeout_s)
        return bytes(answer.result.payload)

    async def endorse(self, *, timeout_s: float | None = None) -> Transaction:
        """Have the peers run it and sign the result. Raises `EndorseError`, `UnsignedError`."""
        signed = self._signed_proposal()
        request = gateway_pb2.EndorseRequest(
            transaction_id=self.tx_id,
            channel_id=self._channel,
            proposed_transaction=signed,
            endorsing_organizations=self._proposed.endorsing_organizations,
        )
        answer = await self._environment.calls.endorse(request, self.tx_id, timeout_s)
        prepared = gateway_pb2.PreparedTransaction(transaction_id=self.tx_id, envelope=answer.prepared_transaction)
        transaction = Transaction(self._environment, prepared)
        self._require_ours(transaction)
        return transaction

    def _signed_proposal(self) -> Any:
        proposal = self._proposed.proposal
        if not proposal.signature:
            proposal.signature = self._environment.sign(proposal.proposal_bytes, self.tx_id)
        return proposal

    def _require_ours(self, transaction: Transaction) -> None:
        """What we are about to sign must be the outcome of what we proposed, whatever the gateway sent back."""
        ours = decode(proposal_pb2.Proposal, self.message, "proposal", MalformedError)
        argument = decode(proposal_pb2.ChaincodeProposalPayload, ours.payload, "proposal payload", MalformedError)
        same_header = (
            transaction.header.channel_header == self._header.channel_header
            and transaction.header.signature_header == self._header.signature_header
        )
        if not same_header or transaction.proposal_input != argument.input:
            raise EndorseError("the gateway returned another transaction than the one proposed", tx_id=self.tx_id)


def new_proposal(
    environment: Environment,
    channel: str,
    chaincode: str,
    arguments: Sequence[bytes],
    *,
    transient: Mapping[str, bytes],
    organizations: Sequence[str],
) -> Proposal:
    """A fresh, unsigned proposal by the environment's identity, now."""
    creator = environment.identity.creator
    nonce = environment.random_bytes(_NONCE_BYTES)
    tx_id = hashlib.sha256(nonce + creator).hexdigest()
    chaincode_id = chaincode_pb2.ChaincodeID(name=chaincode)
    now_ns = environment.now_ns()
    channel_header = common_pb2.ChannelHeader(
        type=common_pb2.ENDORSER_TRANSACTION,
        channel_id=channel,
        tx_id=tx_id,
        extension=proposal_pb2.ChaincodeHeaderExtension(chaincode_id=chaincode_id).SerializeToString(),
        tls_cert_hash=environment.tls_certificate_sha256,
    )
    channel_header.timestamp.seconds, channel_header.timestamp.nanos = divmod(now_ns, 1_000_000_000)
    header = common_pb2.Header(
        channel_header=channel_header.SerializeToString(),
        signature_header=common_pb2.SignatureHeader(creator=creator, nonce=nonce).SerializeToString(),
    )
    specification = chaincode_pb2.ChaincodeInvocationSpec(
        chaincode_spec=chaincode_pb2.ChaincodeSpec(
            type=chaincode_pb2.ChaincodeSpec.NODE,  # what all official clients say, whatever the contract is written in
            chaincode_id=chaincode_id,
            input=chaincode_pb2.ChaincodeInput(args=arguments),
        )
    )
    payload = proposal_pb2.ChaincodeProposalPayload(
        input=specification.SerializeToString(), TransientMap=dict(transient)
    )
    proposal = proposal_pb2.Proposal(header=header.SerializeToString(), payload=payload.SerializeToString())
    proposed = gateway_pb2.ProposedTransaction(
        transaction_id=tx_id,
        proposal=proposal_pb2.SignedProposal(proposal_bytes=proposal.SerializeToString()),
        endorsing_organizations=organizations,
    )
    return Proposal(environment, proposed)


def _header(proposal_bytes: bytes) -> Any:
    proposal = decode(proposal_pb2.Proposal, proposal_bytes, "proposal", MalformedError)
    return decode(common_pb2.Header, proposal.header, "proposal: header", MalformedError)
