"""Stage two: an endorsed transaction, which its sender signs and submits."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.peer import proposal_pb2, proposal_response_pb2, transaction_pb2

from wonderland_fabric_gateway.errors import BlockError, IdentityError
from wonderland_fabric_gateway.gateway.commit import Commit, new_commit
from wonderland_fabric_gateway.gateway.errors import MalformedError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.transactions import Invocation, parse_invocation

if TYPE_CHECKING:
    from wonderland_fabric_gateway.gateway.calls import Environment


class Transaction:
    """An endorsed transaction, signed or not yet. `payload` is what the contract answered, not yet committed."""

    def __init__(self, environment: Environment, prepared: Any) -> None:
        self._environment = environment
        self._prepared = prepared  # gateway.PreparedTransaction
        payload = _decode(common_pb2.Payload, prepared.envelope.payload)
        actions = _decode(transaction_pb2.Transaction, payload.data).actions
        if len(actions) != 1:
            raise MalformedError(f"a transaction of {len(actions)} actions instead of one", tx_id=self.tx_id)
        action = _decode(transaction_pb2.ChaincodeActionPayload, actions[0].payload)
        proposal = _decode(proposal_pb2.ChaincodeProposalPayload, action.chaincode_proposal_payload)
        response = _decode(proposal_response_pb2.ProposalResponsePayload, action.action.proposal_response_payload)
        outcome = _decode(proposal_pb2.ChaincodeAction, response.extension)
        self.header: Any = payload.header
        self.proposal_input: bytes = proposal.input
        self.payload: bytes = outcome.response.payload
        self.channel: str = _decode(common_pb2.ChannelHeader, payload.header.channel_header).channel_id

    @classmethod
    def from_bytes(cls, environment: Environment, data: bytes) -> Transaction:
        """A transaction from `to_bytes`, also of another client. Raises `MalformedError`."""
        prepared = decode(gateway_pb2.PreparedTransaction, data, "transaction", MalformedError)
        if not prepared.transaction_id:
            raise MalformedError("transaction: it has no transaction id")
        return cls(environment, prepared)

    @property
    def tx_id(self) -> str:
        """64 hexadecimal digits: SHA-256 of nonce and creator."""
        return str(self._prepared.transaction_id)

    @property
    def message(self) -> bytes:
        """What is to be signed (ECDSA P-256 over SHA-256 of it, DER, low-S)."""
        return bytes(self._prepared.envelope.payload)

    @property
    def digest(self) -> bytes:
        """SHA-256 of `message`, for signers that take a digest."""
        return hashlib.sha256(self.message).digest()

    def to_bytes(self) -> bytes:
        """``gateway.PreparedTransaction``, to be signed elsewhere or later."""
        return bytes(self._prepared.SerializeToString())

    @property
    def invocation(self) -> Invocation:
        """What the contract did: reads, writes, answer, who endorsed. Raises `MalformedError`."""
        payload = _decode(common_pb2.Payload, self._prepared.envelope.payload)
        try:
            return parse_invocation(payload.data)
        except (BlockError, IdentityError) as cause:
            raise MalformedError(f"the endorsed transaction cannot be read: {cause}", tx_id=self.tx_id) from cause

    def signed(self, signature: bytes) -> Transaction:
        """The same transaction with that signature."""
        copy = gateway_pb2.PreparedTransaction()
        copy.CopyFrom(self._prepared)
        copy.envelope.signature = signature
        return Transaction(self._environment, copy)

    async def submit(self, *, timeout_s: float | None = None) -> Commit:
        """Hand it to the orderer; the answer says nothing of the outcome yet. Raises `SubmitError`, `UnsignedError`."""
        envelope = self._prepared.envelope
        if not envelope.signature:
            envelope.signature = self._environment.sign(envelope.payload, self.tx_id)
        request = gateway_pb2.SubmitRequest(
            transaction_id=self.tx_id, channel_id=self.channel, prepared_transaction=envelope
        )
        await self._environment.calls.submit(request, self.tx_id, timeout_s)
        return self.commit

    @property
    def commit(self) -> Commit:
        """The question what became of it, also for when `submit` did not answer."""
        return new_commit(self._environment, self.channel, self.tx_id)


def _decode(message_type: Any, data: bytes) -> Any:
    return decode(message_type, data, "transaction", MalformedError)
