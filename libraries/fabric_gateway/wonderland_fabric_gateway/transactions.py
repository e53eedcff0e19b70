"""One transaction of a block: who sent it, which function it called, what it read and wrote, and its event.

The nesting, from the outside: Envelope{Payload{Header, Transaction{TransactionAction{ChaincodeActionPayload{
ChaincodeEndorsedAction{ProposalResponsePayload{ChaincodeAction}}}}}}}, as ``peer/transaction.proto`` explains it.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.ledger.rwset import rwset_pb2
from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2
from fabric_protos.peer import (
    chaincode_event_pb2,
    chaincode_pb2,
    proposal_pb2,
    proposal_response_pb2,
    transaction_pb2,
)

from wonderland_fabric_gateway.channel_config import ChannelConfig, parse_channel_config
from wonderland_fabric_gateway.errors import BlockError, IdentityError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_TIME_S: Final = 253_402_300_799  # the end of the year 9999


class ValidationCode(IntEnum):
    """Fabric's TxValidationCode: what the peers decided about a transaction."""

    VALID = 0
    NIL_ENVELOPE = 1
    BAD_PAYLOAD = 2
    BAD_COMMON_HEADER = 3
    BAD_CREATOR_SIGNATURE = 4
    INVALID_ENDORSER_TRANSACTION = 5
    INVALID_CONFIG_TRANSACTION = 6
    UNSUPPORTED_TX_PAYLOAD = 7
    BAD_PROPOSAL_TXID = 8
    DUPLICATE_TXID = 9
    ENDORSEMENT_POLICY_FAILURE = 10
    MVCC_READ_CONFLICT = 11
    PHANTOM_READ_CONFLICT = 12
    UNKNOWN_TX_TYPE = 13
    TARGET_CHAIN_NOT_FOUND = 14
    MARSHAL_TX_ERROR = 15
    NIL_TXACTION = 16
    EXPIRED_CHAINCODE = 17
    CHAINCODE_VERSION_CONFLICT = 18
    BAD_HEADER_EXTENSION = 19
    BAD_CHANNEL_HEADER = 20
    BAD_RESPONSE_PAYLOAD = 21
    BAD_RWSET = 22
    ILLEGAL_WRITESET = 23
    INVALID_WRITESET = 24
    INVALID_CHAINCODE = 25
    NOT_VALIDATED = 254
    INVALID_OTHER_REASON = 255


_CODE_NAMES: Final[dict[int, str]] = {int(code): code.name for code in ValidationCode}


class TransactionType(StrEnum):
    """What a transaction is. `malformed` occurs only on transactions that the peers refused."""

    ENDORSER = "endorser"
    CONFIG = "config"
    UNSUPPORTED = "unsupported"
    MALFORMED = "malformed"


@dataclass(frozen=True, slots=True)
class Version:
    """Where a key was last written: block number and the transaction's index in it."""

    block: int
    transaction: int


@dataclass(frozen=True, slots=True)
class Read:
    """A key that was read, and the version found; None when it was not there."""

    key: str
    version: Version | None


@dataclass(frozen=True, slots=True)
class Write:
    """A key that was written or deleted; the value of a deletion is empty."""

    key: str
    value: bytes
    is_delete: bool


@dataclass(frozen=True, slots=True)
class MetadataWrite:
    """A key whose metadata was set: all its entries (name, value), for example VALIDATION_PARAMETER."""

    key: str
    entries: tuple[tuple[str, bytes], ...]


@dataclass(frozen=True, slots=True)
class ReadsSummary:
    """The top of the Merkle tree over a long range's keys and versions (``kvrwset.QueryReadsMerkleSummary``)."""

    max_degree: int
    max_level: int
    hashes: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class RangeQuery:
    """A range that was read: `end_key` is excluded, "" is open; `exhausted` when it was read to its end.

    `reads` is None when the peer recorded only a Merkle summary of what it saw, in `summary`.
    """

    start_key: str
    end_key: str
    exhausted: bool
    reads: tuple[Read, ...] | None
    summary: ReadsSummary | None = None


@dataclass(frozen=True, slots=True)
class NamespaceAccess:
    """What a transaction read and wrote in one namespace (a chaincode's name, or ``_lifecycle``)."""

    namespace: str
    reads: tuple[Read, ...]
    range_queries: tuple[RangeQuery, ...]
    writes: tuple[Write, ...]
    metadata_writes: tuple[MetadataWrite, ...] = ()


@dataclass(frozen=True, slots=True)
class ChaincodeEvent:
    """The event that the contract set."""

    chaincode: str
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Response:
    """What the contract answered: a status (200 is success), a message for errors and the result."""

    status: int
    message: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Endorsement:
    """A peer's signature, over `signed` ‖ its serialised identity."""

    endorser: Identity
    signature: bytes


@dataclass(frozen=True, slots=True)
class Invocation:
    """The part of a transaction that a contract made. `args` begins with the function's name, as Fabric sends it."""

    chaincode: str
    chaincode_version: str
    args: tuple[bytes, ...]
    response: Response
    event: ChaincodeEvent | None
    accesses: tuple[NamespaceAccess, ...]
    endorsements: tuple[Endorsement, ...]
    proposal_hash: bytes
    proposal_payload: bytes
    response_payload: bytes

    @property
    def function(self) -> str:
        """The name of the function that was called; "" without one. Bytes that are no UTF-8 show as U+FFFD."""
        return self.args[0].decode(errors="replace") if self.args else ""


@dataclass(frozen=True, slots=True)
class Transaction:
    """A transaction in its block. `timestamp_ms` (Unix epoch) is only the client's word.

    `creator` is None on the first config block, which nobody signs. `invocation` is there for type `endorser`,
    `config` for type `config`, `problem` for type `malformed`.
    """

    index: int
    tx_id: str
    type: TransactionType
    validation_code: int
    channel: str
    timestamp_ms: int
    creator: Identity | None
    nonce: bytes
    signature: bytes
    invocation: Invocation | None = None
    config: ChannelConfig | None = None
    problem: str = ""

    @property
    def is_valid(self) -> bool:
        """Whether the peers committed its writes."""
        return self.validation_code == 0

    @property
    def validation_name(self) -> str:
        """The validation code's name: VALID, MVCC_READ_CONFLICT and so on."""
        return code_name(self.validation_code)

    @property
    def event(self) -> ChaincodeEvent | None:
        """The contract's event. Only that of a valid transaction means that something happened."""
        return self.invocation.event if self.invocation else None

    @property
    def writes(self) -> Iterator[tuple[str, Write]]:
        """All writes with their namespaces."""
        for access in self.invocation.accesses if self.invocation else ():
            for write in access.writes:
                yield access.namespace, write

    @property
    def endorsers(self) -> tuple[Identity, ...]:
        """The peers that endorsed."""
        return tuple(each.endorser for each in self.invocation.endorsements) if self.invocation else ()


def code_name(validation_code: int) -> str:
    """The name of a validation code; one that is not known shows as ``CODE_<number>``."""
    return _CODE_NAMES.get(validation_code, f"CODE_{validation_code}")


def parse_transaction(envelope: bytes, index: int, validation_code: int) -> Transaction:
    """Parse an envelope of a block. Raises `BlockError`, but for invalid transactions gives type `malformed`."""
    try:
        return _transaction(envelope, index, validation_code)
    except (BlockError, IdentityError) as cause:
        if validation_code == 0:
            raise BlockError(f"transaction {index} is marked valid but malformed: {cause}") from cause
        return _malformed(envelope, index, validation_code, str(cause))


def parse_invocation(transaction_data: bytes) -> Invocation:
    """Read a ``peer.Transaction`` (the payload's data): what the contract did. Raises `BlockError`, `IdentityError`."""
    actions = _decode(transaction_pb2.Transaction, transaction_data, "transaction").actions
    if len(actions) != 1:
        raise BlockError(f"{len(actions)} actions; Fabric allows exactly one")
    payload = _decode(transaction_pb2.ChaincodeActionPayload, actions[0].payload, "action")
    endorsed = payload.action
    response = _decode(proposal_response_pb2.ProposalResponsePayload, endorsed.proposal_response_payload, "response")
    action = _decode(proposal_pb2.ChaincodeAction, response.extension, "chaincode action")
    proposal = _decode(proposal_pb2.ChaincodeProposalPayload, payload.chaincode_proposal_payload, "proposal")
    spec = _decode(chaincode_pb2.ChaincodeInvocationSpec, proposal.input, "invocation").chaincode_spec
    return Invocation(
        chaincode=action.chaincode_id.name,
        chaincode_version=action.chaincode_id.version,
        args=tuple(spec.input.args),
        response=Response(action.response.status, action.response.message, action.response.payload),
        event=_event(action.events),
        accesses=parse_accesses(action.results),
        endorsements=_endorsements(endorsed.endorsements),
        proposal_hash=response.proposal_hash,
        proposal_payload=payload.chaincode_proposal_payload,
        response_payload=endorsed.proposal_response_payload,
    )


def _endorsements(given: Any) -> tuple[Endorsement, ...]:
    """Those by somebody. One by no identity at all counts for nobody, and Fabric's peers pass over it, too."""
    found: list[Endorsement] = []
    for each in given:
        with contextlib.suppress(IdentityError):
            found.append(Endorsement(Identity.from_creator(each.endorser), each.signature))
    return tuple(found)


def parse_accesses(results: bytes) -> tuple[NamespaceAccess, ...]:
    """Read a ``rwset.TxReadWriteSet``. Raises `BlockError`."""
    found = _decode(rwset_pb2.TxReadWriteSet, results, "read-write set")
    accesses = []
    for each in found.ns_rwset:
        keys = _decode(kv_rwset_pb2.KVRWSet, each.rwset, f"read-write set of {each.namespace}")
        accesses.append(
            NamespaceAccess(
                namespace=each.namespace,
                reads=_reads(keys.reads),
                range_queries=tuple(_range_query(query) for query in keys.range_queries_info),
                writes=tuple(Write(write.key, write.value, write.is_delete) for write in keys.writes),
                metadata_writes=tuple(
                    MetadataWrite(each.key, tuple((entry.name, entry.value) for entry in each.entries))
                    for each in keys.metadata_writes
                ),
            ),
        )
    return tuple(accesses)


def _transaction(envelope: bytes, index: int, validation_code: int) -> Transaction:
    outer = _decode(common_pb2.Envelope, envelope, "envelope")
    payload = _decode(common_pb2.Payload, outer.payload, "payload")
    channel = _decode(common_pb2.ChannelHeader, payload.header.channel_header, "channel header")
    signed = _decode(common_pb2.SignatureHeader, payload.header.signature_header, "signature header")
    invocation: Invocation | None = None
    config: ChannelConfig | None = None
    if channel.type == common_pb2.ENDORSER_TRANSACTION:
        kind = TransactionType.ENDORSER
        invocation = parse_invocation(payload.data)
    elif channel.type == common_pb2.CONFIG:
        kind = TransactionType.CONFIG
        config = parse_channel_config(payload.data)
    else:
        kind = TransactionType.UNSUPPORTED
    if not signed.creator and kind is not TransactionType.CONFIG:
        raise BlockError("no creator")
    return Transaction(
        index=index,
        tx_id=channel.tx_id,
        type=kind,
        validation_code=validation_code,
        channel=channel.channel_id,
        timestamp_ms=_timestamp_ms(channel.timestamp),
        creator=Identity.from_creator(signed.creator) if signed.creator else None,
        nonce=signed.nonce,
        signature=outer.signature,
        invocation=invocation,
        config=config,
    )


def _malformed(envelope: bytes, index: int, validation_code: int, problem: str) -> Transaction:
    """What can be said of a refused transaction that cannot be read whole: its id, if that much can be read."""
    tx_id = channel_id = ""
    try:
        payload = _decode(common_pb2.Payload, _decode(common_pb2.Envelope, envelope, "").payload, "")
        header = _decode(common_pb2.ChannelHeader, payload.header.channel_header, "")
        tx_id, channel_id = header.tx_id, header.channel_id
    except BlockError:
        pass
    return Transaction(
        index=index,
        tx_id=tx_id,
        type=TransactionType.MALFORMED,
        validation_code=validation_code,
        channel=channel_id,
        timestamp_ms=0,
        creator=None,
        nonce=b"",
        signature=b"",
        problem=problem,
    )


def _event(data: bytes) -> ChaincodeEvent | None:
    if not data:
        return None
    event = _decode(chaincode_event_pb2.ChaincodeEvent, data, "event")
    return ChaincodeEvent(event.chaincode_id, event.event_name, event.payload)


def _reads(reads: Any) -> tuple[Read, ...]:
    return tuple(
        Read(read.key, Version(read.version.block_num, read.version.tx_num) if read.HasField("version") else None)
        for read in reads
    )


def _range_query(query: Any) -> RangeQuery:
    place = query.start_key, query.end_key, query.itr_exhausted
    if query.WhichOneof("reads_info") != "reads_merkle_hashes":
        return RangeQuery(*place, _reads(query.raw_reads.kv_reads))
    found = query.reads_merkle_hashes
    summary = ReadsSummary(found.max_degree, found.max_level, tuple(found.max_level_hashes))
    return RangeQuery(*place, None, summary)


def _timestamp_ms(timestamp: Any) -> int:
    if not (0 <= timestamp.seconds <= MAX_TIME_S and 0 <= timestamp.nanos < 1_000_000_000):
        raise BlockError(f"a timestamp of {timestamp.seconds} s and {timestamp.nanos} ns")
    return int(timestamp.seconds) * 1000 + int(timestamp.nanos) // 1_000_000


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, BlockError)
