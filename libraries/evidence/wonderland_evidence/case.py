"""A bundle read as what it is: config blocks, headers, transactions. Nothing here judges; `steps` does."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.peer import chaincode_pb2, proposal_pb2, proposal_response_pb2, transaction_pb2

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland_evidence.bundle import Bundle, BundleBlock, ValidityAnswer
from wonderland_evidence.errors import MissingBlockError, StepError
from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.transactions import (
    Endorsement,
    Invocation,
    Response,
    TransactionType,
    Version,
    parse_transaction,
)
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_gateway.verification.transaction_checks import SignedTransaction

QUERY: Final = "qscc"
QUESTION: Final = b"GetTransactionByID"
ENDINGS: Final = ("CompleteInteraction", "CancelProof")
NO_VERDICT: Final = "this file has no verdict of the session"
NO_END: Final = "this file does not say how the session ended"
SESSION_FUNCTIONS: Final = ("WitnessProof", "SubmitProof", "CompleteInteraction", "CancelProof")
EMBEDDED: Final = "embedded"
_NOT_VALIDATED: Final = 254
MAX_ARGUMENT: Final = 8 << 20


@dataclass(frozen=True)
class Answer:
    """A validity answer, read: about which transaction, and what was said."""

    raw: ValidityAnswer
    tx_id: str
    asked_ms: int
    channel: str
    chaincode: str
    invocation: Invocation
    """Only response and endorsements of it mean anything."""
    processed: Any
    """``peer.ProcessedTransaction``."""


class Case:
    """A bundle under examination."""

    def __init__(self, bundle: Bundle) -> None:
        self.bundle: Final = bundle
        self.blocks: Final = {block.number: block for block in bundle.blocks}
        self._transactions: dict[Version, SignedTransaction] = {}
        self.used: dict[Version, str] | None = None
        """What the session rests on (`derive.rests_on`), once it is known."""

    @cached_property
    def trusts(self) -> tuple[ChannelTrust, ...]:
        """What each config block says, oldest first. Raises `LedgerError`."""
        return tuple(
            ChannelTrust.of(block.number, block.data[0])
            for block in self.bundle.blocks
            if block.data is not None and len(block.data) == 1 and _is_config(block.data[0])
        )

    def trust_before(self, number: int) -> ChannelTrust:
        """The configuration that was in force when a block was made."""
        for trust in reversed(self.trusts):
            if trust.number < max(number, 1):
                return trust
        raise MissingBlockError(0, "the channel's first block is where trust begins")

    @property
    def is_embedded(self) -> bool:
        """Whether one process made the channel, and holds the keys of all its organisations."""
        return self.trusts[0].consensus == EMBEDDED

    @property
    def genesis(self) -> BundleBlock:
        """The channel's first block. Raises `MissingBlockError`."""
        return self.block(0, "the channel's first block is where trust begins")

    def block(self, number: int, why: str) -> BundleBlock:
        """A whole block. Raises `MissingBlockError`."""
        found = self.blocks.get(number)
        if found is None or found.data is None:
            raise MissingBlockError(number, why)
        return found

    def transaction(self, place: Version, why: str) -> SignedTransaction:
        """An endorsed transaction. Raises `MissingBlockError`, `StepError`, `BlockError`."""
        if place not in self._transactions:
            data = self.block(place.block, why).data or ()
            if place.transaction >= len(data):
                raise StepError(f"block {place.block} has no transaction {place.transaction}: {why}")
            self._transactions[place] = SignedTransaction.read(data[place.transaction], place.transaction)
        return self._transactions[place]

    @cached_property
    def answers(self) -> tuple[Answer, ...]:
        """The validity answers, read. Raises `BlockError`."""
        return tuple(_answer(each) for each in self.bundle.validity)

    @cached_property
    def places(self) -> dict[str, Version]:
        """Where each transaction stands by its id; of a repeated one the first."""
        found: dict[str, Version] = {}
        for block in self.bundle.blocks:
            for index, envelope in enumerate(block.data or ()):
                found.setdefault(parse_transaction(envelope, index, _NOT_VALIDATED).tx_id, Version(block.number, index))
        return found

    @cached_property
    def session(self) -> dict[Version, str]:
        """The session's own transactions in their order, each with its function: those that peers were asked about."""
        found = {}
        for answer in self.answers:
            place = self.places.get(answer.tx_id)
            if place is None:
                raise StepError(f"the transaction {answer.tx_id[:16]}… that peers were asked about is not in the file")
            function = self.transaction(place, "peers were asked about it").invocation.function
            found[place] = function
        return dict(sorted(found.items(), key=lambda each: (each[0].block, each[0].transaction)))

    def of_session(self, function: str) -> Version | None:
        """The session's transaction of that function, or None."""
        return next((place for place, name in self.session.items() if name == function), None)

    @property
    def lacks(self) -> tuple[str, ...]:
        """What of the session is not in the file, in words. The ledger may have it: a file can be cut."""
        found = [] if self.of_session("SubmitProof") else [NO_VERDICT]
        return (*found,) if set(self.session.values()) & set(ENDINGS) else (*found, NO_END)

    @cached_property
    def gaps(self) -> tuple[tuple[int, int], ...]:
        """Numbers, from and to, of blocks that are not in the file, between its first and its last."""
        pairs = itertools.pairwise(each.number for each in self.bundle.blocks)
        return tuple((before + 1, after - 1) for before, after in pairs if after > before + 1)

    @cached_property
    def signed_blocks(self) -> tuple[BundleBlock, ...]:
        """All but the first one, which nobody signs."""
        return tuple(each for each in self.bundle.blocks if each.number)

    def time_ms(self, number: int) -> int:
        """When a block was made, by the middle of its senders' times; a neighbour has a near block's."""
        numbers, times = self._times
        return times[max(0, bisect_right(numbers, number) - 1)]

    @cached_property
    def _times(self) -> tuple[list[int], list[int]]:
        """Numbers of the whole blocks, and the time of each."""
        found: dict[int, int] = {}
        for block in self.bundle.blocks:
            if block.data is not None:
                times = sorted(parse_transaction(each, 0, _NOT_VALIDATED).timestamp_ms for each in block.data)
                found[block.number] = times[len(times) // 2]
        return list(found), list(found.values())


def is_about(invocation: Invocation, session_id: str) -> bool:
    """Whether a call's argument names that session."""
    try:
        argument = encoding.decode(invocation.args[1], max_bytes=MAX_ARGUMENT) if len(invocation.args) == 2 else {}
    except EncodingError:
        return False
    return isinstance(argument, dict) and argument.get("session_id") == session_id


def _is_config(envelope: bytes) -> bool:
    return parse_transaction(envelope, 0, _NOT_VALIDATED).type is TransactionType.CONFIG


def _answer(raw: ValidityAnswer) -> Answer:
    what = "validity answer"
    header = decode(common_pb2.ChannelHeader, raw.channel_header, what, BlockError)
    payload = decode(proposal_pb2.ChaincodeProposalPayload, raw.proposal, what, BlockError)
    spec = decode(chaincode_pb2.ChaincodeInvocationSpec, payload.input, what, BlockError).chaincode_spec
    arguments = tuple(spec.input.args)
    if len(arguments) != 3 or arguments[0] != QUESTION:
        raise BlockError("a validity answer to another question than GetTransactionByID")
    invocation = invocation_of(raw)
    return Answer(
        raw=raw,
        tx_id=arguments[2].decode(errors="replace"),
        asked_ms=header.timestamp.ToMilliseconds(),
        channel=arguments[1].decode(errors="replace"),
        chaincode=spec.chaincode_id.name,
        invocation=invocation,
        processed=decode(transaction_pb2.ProcessedTransaction, invocation.response.payload, what, BlockError),
    )


def invocation_of(raw: ValidityAnswer) -> Invocation:
    """The answer in the form in which a transaction has it, so that the same check serves both."""
    response = decode(proposal_response_pb2.ProposalResponsePayload, raw.response, "validity answer", BlockError)
    action = decode(proposal_pb2.ChaincodeAction, response.extension, "validity answer", BlockError)
    return Invocation(
        chaincode=action.chaincode_id.name,
        chaincode_version=action.chaincode_id.version,
        args=(),
        response=Response(action.response.status, action.response.message, action.response.payload),
        event=None,
        accesses=(),
        endorsements=tuple(Endorsement(Identity.from_creator(who), signature) for who, signature in raw.endorsements),
        proposal_hash=response.proposal_hash,
        proposal_payload=raw.proposal,
        response_payload=raw.response,
    )
