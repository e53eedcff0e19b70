"""Stage three: what became of a submitted transaction."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fabric_protos.gateway import gateway_pb2

from wonderland_fabric_gateway.gateway.errors import CommitError, MalformedError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.transactions import ValidationCode, code_name

if TYPE_CHECKING:
    from wonderland_fabric_gateway.gateway.calls import Environment


@dataclass(frozen=True, slots=True)
class CommitStatus:
    """The outcome: the validation code and the block that holds the transaction."""

    tx_id: str
    code: int
    block_number: int

    @property
    def is_valid(self) -> bool:
        """Whether its writes happened."""
        return self.code == ValidationCode.VALID

    @property
    def code_name(self) -> str:
        """The validation code's name: VALID, MVCC_READ_CONFLICT and so on."""
        return code_name(self.code)

    def require_valid(self) -> None:
        """Raise `CommitError` unless its writes happened."""
        if not self.is_valid:
            raise CommitError(tx_id=self.tx_id, code=self.code, block_number=self.block_number)


class Commit:
    """The question for an outcome, signed or not yet. It may be asked again and again."""

    def __init__(self, environment: Environment, request: Any) -> None:
        self._environment = environment
        self._request = request  # gateway.SignedCommitStatusRequest
        asked = decode(gateway_pb2.CommitStatusRequest, request.request, "commit request", MalformedError)
        self.tx_id: str = asked.transaction_id

    @classmethod
    def from_bytes(cls, environment: Environment, data: bytes) -> Commit:
        """A commit request from `to_bytes`, also of another client. Raises `MalformedError`."""
        request = decode(gateway_pb2.SignedCommitStatusRequest, data, "commit request", MalformedError)
        commit = cls(environment, request)
        if not commit.tx_id:
            raise MalformedError("commit request: it has no transaction id")
        return commit

    @property
    def message(self) -> bytes:
        """What is to be signed (ECDSA P-256 over SHA-256 of it, DER, low-S)."""
        return bytes(self._request.request)

    @property
    def digest(self) -> bytes:
        """SHA-256 of `message`, for signers that take a digest."""
        return hashlib.sha256(self.message).digest()

    def to_bytes(self) -> bytes:
        """``gateway.SignedCommitStatusRequest``, to be signed elsewhere or later."""
        return bytes(self._request.SerializeToString())

    def signed(self, signature: bytes) -> Commit:
        """The same question with that signature."""
        request = gateway_pb2.SignedCommitStatusRequest(request=self._request.request, signature=signature)
        return Commit(self._environment, request)

    async def status(self, *, timeout_s: float | None = None) -> CommitStatus:
        """Wait until the transaction is in a block. Raises `CommitStatusError`, `UnsignedError`.

        A transaction that nobody submitted is waited for until the deadline, too: the peer cannot know.
        """
        if not self._request.signature:
            self._request.signature = self._environment.sign(self._request.request, self.tx_id)
        answer = await self._environment.calls.commit_status(self._request, self.tx_id, timeout_s)
        return CommitStatus(self.tx_id, int(answer.result), int(answer.block_number))


def new_commit(environment: Environment, channel: str, tx_id: str) -> Commit:
    """The question for any transaction's outcome, by the environment's identity."""
    asked = gateway_pb2.CommitStatusRequest(
        transaction_id=tx_id, channel_id=channel, identity=environment.identity.creator
    )
    request = gateway_pb2.SignedCommitStatusRequest(request=asked.SerializeToString())
    return Commit(environment, request)
