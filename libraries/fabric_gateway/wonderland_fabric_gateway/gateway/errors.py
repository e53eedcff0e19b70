"""What can go wrong on the way to a committed transaction, told apart by what the caller may conclude.

- `EvaluateError`, `EndorseError`: nothing was sent for ordering; the contract or a peer said no.
- `SubmitError`: the orderer said no, or (`outcome_unknown`) nobody knows whether it took the transaction.
- `CommitStatusError`: the question for the outcome failed; the transaction may be committed or not.
- `CommitError`: the transaction is in a block and **invalid**; its writes did not happen.
- `CommitUnknownError`: submitted, and within the deadline nobody said what became of it. Ask again later with
  the transaction id; a second *proposal* may do the thing twice (the same transaction sent again does not).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeVar

import grpc
from fabric_protos.gateway import gateway_pb2
from google.protobuf.message import DecodeError
from google.rpc import status_pb2

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.transactions import ValidationCode, code_name

if TYPE_CHECKING:
    from collections.abc import Iterable

_STATUS_DETAILS: Final = "grpc-status-details-bin"
_CHAINCODE_RESPONSE: Final = re.compile(r"chaincode response (\d{1,9}), (.*)", re.DOTALL)
_OUTCOME_UNKNOWN: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.DEADLINE_EXCEEDED,
        grpc.StatusCode.CANCELLED,
        grpc.StatusCode.INTERNAL,  # also what a connection that was reset in mid-call looks like
        grpc.StatusCode.UNKNOWN,
    }
)
_UNREACHED: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.DEADLINE_EXCEEDED,
        grpc.StatusCode.CANCELLED,
        grpc.StatusCode.INTERNAL,
    }
)
_NO_ENDORSERS: Final = re.compile(
    r"no combination of peers can be derived|failed to select a set of endorsers|no endorsement combination"
    r"|failed to find any endorsing peers|no peers available to",
)
_FOR_EVER: Final = "this ledger"
"""The embedded ledger's word for what does not change by waiting: there, one node has all endorsers."""
MAX_DETAILS: Final = 100


@dataclass(frozen=True, slots=True)
class ErrorDetail:
    """What one peer or orderer said: its address, its MSP and its message."""

    address: str
    msp_id: str
    message: str


@dataclass(frozen=True, slots=True)
class ChaincodeResponse:
    """The contract's own refusal: its status (400, 403, …) and its text."""

    status: int
    message: str


class GatewayError(LedgerError):
    """A call to the Gateway failed. `status_code` is gRPC's, or None when no call was answered at all."""

    operation = "the call"

    def __init__(
        self,
        message: str,
        *,
        tx_id: str = "",
        status_code: grpc.StatusCode | None = None,
        details: tuple[ErrorDetail, ...] = (),
    ) -> None:
        super().__init__(message)
        self.message = message
        self.tx_id = tx_id
        self.status_code = status_code
        self.details = details

    def __str__(self) -> str:
        parts = [f"{self.operation} failed"]
        if self.tx_id:
            parts.append(f" (transaction {self.tx_id})")
        parts.append(f": {self.status_code.name if self.status_code else 'ERROR'}: {self.message}")
        parts += [f"; {each.msp_id or '?'} at {each.address or '?'}: {each.message}" for each in self.details]
        return "".join(parts)

    @property
    def is_unreached(self) -> bool:
        """Whether the Gateway itself could not be reached or was silent, and did not say why it failed."""
        return self.status_code in _UNREACHED and not self.details

    @property
    def has_no_endorsers(self) -> bool:
        """The peers do not know each other well enough to endorse, as after a start; that passes within seconds."""
        return bool(_NO_ENDORSERS.search(self.message)) and _FOR_EVER not in self.message

    @property
    def chaincode_response(self) -> ChaincodeResponse | None:
        """The contract's status and text, when it was the contract that refused."""
        for text in (*(each.message for each in self.details), self.message):
            found = _CHAINCODE_RESPONSE.search(text)
            if found:
                return ChaincodeResponse(int(found[1]), found[2])
        return None


class EvaluateError(GatewayError):
    """A query failed."""

    operation = "evaluate"


class EndorseError(GatewayError):
    """The endorsers refused or disagreed; nothing was submitted."""

    operation = "endorse"

    @property
    def is_mismatch(self) -> bool:
        """The peers gave different results, usually since they stood at different blocks; a new attempt may do."""
        texts = (self.message, *(each.message for each in self.details))
        return self.status_code is grpc.StatusCode.ABORTED and any(
            "ProposalResponsePayloads do not match" in text for text in texts
        )


class SubmitError(GatewayError):
    """The transaction was not taken for ordering, or, with `outcome_unknown`, maybe it was."""

    operation = "submit"

    @property
    def outcome_unknown(self) -> bool:
        """Whether it may still be committed: then ask for the commit status instead of sending anything again."""
        return self.status_code in _OUTCOME_UNKNOWN


class CommitStatusError(GatewayError):
    """The outcome could not be learned this time."""

    operation = "commit status"


class CommitError(GatewayError):
    """The transaction is in block `block_number` and invalid, for the reason `code`; its writes did not happen."""

    operation = "commit"

    def __init__(self, *, tx_id: str, code: int, block_number: int) -> None:
        super().__init__(f"invalid in block {block_number}: {code_name(code)} ({code})", tx_id=tx_id)
        self.code = code
        self.code_name = code_name(code)
        self.block_number = block_number

    def __str__(self) -> str:
        return f"transaction {self.tx_id} is {self.message}"

    @property
    def is_conflict(self) -> bool:
        """Another transaction changed in between what this one had read; a new attempt reads afresh."""
        return self.code in {ValidationCode.MVCC_READ_CONFLICT, ValidationCode.PHANTOM_READ_CONFLICT}


class CommitUnknownError(GatewayError):
    """Within the deadline nobody said whether the transaction was committed. It may be, or may still become so."""

    operation = "commit"


class StreamError(GatewayError):
    """An event or block stream ended. `status_code` UNAVAILABLE means that it is worth opening it again."""

    operation = "stream"


class BehindError(StreamError):
    """The peer's chain is shorter than what was seen of it: it is catching up, or it is not the same chain."""


class UnknownTransactionError(StreamError):
    """The transaction or block to continue after is not on this chain: the checkpoint is of another ledger."""


class UnsignedError(GatewayError):
    """There is no signer and no signature: sign `message` offline and pass the signature on."""

    operation = "sign"


class MalformedError(GatewayError):
    """Bytes that are no proposal, transaction or commit request, or an answer that is none."""

    operation = "decode"


RaisedError = TypeVar("RaisedError", bound=GatewayError)


def from_rpc(error: grpc.aio.AioRpcError, kind: type[RaisedError], tx_id: str = "") -> RaisedError:
    """The typed error for a failed call."""
    trailers = error.trailing_metadata() or ()
    return kind(
        error.details() or "no further explanation",
        tx_id=tx_id,
        status_code=error.code(),
        details=tuple(_details(trailers)),
    )


def _details(trailers: Iterable[tuple[str, str | bytes]]) -> Iterable[ErrorDetail]:
    """What is in the trailer ``grpc-status-details-bin`` (google.rpc.Status). Garbage there hides no error: skipped."""
    for name, value in trailers:
        if name != _STATUS_DETAILS or not isinstance(value, bytes):
            continue
        try:
            for packed in status_pb2.Status.FromString(value).details[:MAX_DETAILS]:
                detail = gateway_pb2.ErrorDetail()
                if packed.Unpack(detail):
                    yield ErrorDetail(detail.address, detail.msp_id, detail.message)
        except DecodeError:
            continue
