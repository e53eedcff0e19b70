"""From a block to rows, without I/O: everything follows from the write sets of valid transactions.

A value whose form this version does not know becomes an `UnreadRow`, so that it is seen and counted, and the mirror
goes on: the chain itself is sound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import orjson

from wonderland.proofs.records import keys
from wonderland_backend.db.tables.base import LedgerRow
from wonderland_backend.db.tables.ledger import (
    AssetRow,
    AuthorisationRow,
    BlockRow,
    CertificateRow,
    ClosuresRow,
    DroneRow,
    EventRow,
    EvidenceRow,
    OrganisationRow,
    PadRow,
    PolicyRow,
    RecordVersionRow,
    SessionRow,
    TransactionRow,
    UnreadRow,
    VerdictRow,
)
from wonderland_backend.mirror.certificates import note_signers
from wonderland_fabric_gateway.blocks import Block, Transaction
from wonderland_fabric_gateway.channel_config import ChannelConfig
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.transactions import Write

Row = dict[str, Any]
Key = tuple[str, ...]

_SUBMIT_PROOF: Final = "SubmitProof"
_IDENTIFIER: Final = 128
_PROBLEM: Final = 300


@dataclass
class Changes:
    """Rows of some blocks in order: what to insert, what to upsert, what to delete; and what to tell the live side."""

    blocks: list[Row] = field(default_factory=list)
    transactions: list[Row] = field(default_factory=list)
    events: list[Row] = field(default_factory=list)
    unread: list[Row] = field(default_factory=list)
    versions: list[Row] = field(default_factory=list)
    upserts: dict[type[LedgerRow], dict[Key, Row]] = field(default_factory=dict)
    deletes: dict[type[LedgerRow], set[Key]] = field(default_factory=dict)
    organisations: list[Row] | None = None
    """All of them, when a configuration came; it replaces the one before."""

    session_writes: list[Row] = field(default_factory=list)
    """Every state of every session, in order."""
    verdict_writes: list[Row] = field(default_factory=list)

    @property
    def last(self) -> Row:
        """The last block's row."""
        return self.blocks[-1]

    def put(self, table: type[LedgerRow], key: Key, row: Row) -> None:
        """Upsert a row; the last write of a key counts."""
        rows = self.upserts.setdefault(table, {})
        before = rows.get(key)
        if before is not None and table is SessionRow:
            for name in ("verdict_tx", "complete_tx"):
                row[name] = row[name] if row[name] is not None else before[name]
        rows[key] = row
        self.deletes.get(table, set()).discard(key)

    def remove(self, table: type[LedgerRow], key: Key) -> None:
        """Delete a row."""
        self.upserts.get(table, {}).pop(key, None)
        self.deletes.setdefault(table, set()).add(key)


class Unreadable(Exception):  # noqa: N818 - caught here and turned into a row
    """A value that has not the form this version knows."""


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a write stands."""

    block: int
    tx_index: int
    tx_id: str


def derive(block: Block, chaincode: str, changes: Changes) -> None:
    """Add what a block says to `changes`. Raises nothing: blocks were checked when they were parsed."""
    t_ms = 0
    valid = 0
    for transaction in block.transactions:
        t_ms = max(t_ms, transaction.timestamp_ms)
        changes.transactions.append(_transaction_row(block.number, transaction))
        if not transaction.is_valid:
            continue
        valid += 1
        if transaction.config is not None:
            changes.organisations = _organisation_rows(transaction.config, block.number, transaction.index)
        if transaction.invocation is not None:
            _invocation(block.number, transaction, chaincode, changes)
            note_signers(changes.upserts.setdefault(CertificateRow, {}), block.number, transaction)
    changes.blocks.append(
        {
            "number": block.number,
            "header_hash": block.header_hash.hex(),
            "previous_hash": block.header.previous_hash.hex(),
            "data_hash": block.header.data_hash.hex(),
            "t_ms": t_ms,
            "transactions": len(block.transactions),
            "valid": valid,
            "size_bytes": sum(map(len, block.envelopes)),
        }
    )


def _invocation(number: int, transaction: Transaction, chaincode: str, changes: Changes) -> None:
    place = _Place(number, transaction.index, transaction.tx_id)
    event = transaction.event
    if event is not None:
        changes.events.append(
            {
                "block": number,
                "tx_index": transaction.index,
                "name": _text(event.name)[:_IDENTIFIER],
                "payload": _text(event.payload),
            }
        )
    for position, (namespace, write) in enumerate(transaction.writes):
        if namespace != chaincode:
            continue
        try:
            _write(place, write, changes)
        except Unreadable as problem:
            _unread(changes, place, position, str(problem), namespace=namespace, key=write.key)
    assert transaction.invocation is not None
    if transaction.invocation.chaincode == chaincode and transaction.invocation.function == _SUBMIT_PROOF:
        try:
            _evidence(place, transaction.invocation.args, changes)
        except Unreadable as problem:
            _unread(changes, place, -1, str(problem), namespace=chaincode, key=_SUBMIT_PROOF)


def _write(place: _Place, write: Write, changes: Changes) -> None:
    kind, names = keys.split(write.key)
    if kind in _WITHOUT_ROWS:
        return
    reader = _READERS.get(kind)
    if reader is None:
        raise Unreadable(f"no such kind of record: {kind!r}" if kind else "not a composite key")
    table, width, read = reader
    if len(names) != width or any(not 0 < len(name) <= _IDENTIFIER for name in names):
        raise Unreadable(f"a key of {kind} has {width} parts of 1 to {_IDENTIFIER} characters")
    if write.is_delete:
        changes.remove(table, names)
        return
    record, text = _parse(write.value)
    try:
        row = read(record, names, place)
    except (KeyError, TypeError, ValueError) as cause:
        raise Unreadable(f"{kind}: {type(cause).__name__} {cause}") from cause
    row["record"] = text
    row["block"] = place.block
    row["tx_index"] = place.tx_index
    changes.put(table, names, row)
    if table is SessionRow:
        changes.session_writes.append(row)
    elif table is VerdictRow:
        changes.verdict_writes.append(row)
    elif kind in VERSIONED:
        changes.versions.append(
            {
                "kind": kind,
                "key": "/".join(names)[:_IDENTIFIER],
                "block": place.block,
                "tx_index": place.tx_index,
                "record": text,
            }
        )


def _parse(value: bytes) -> tuple[dict[str, Any], str]:
    try:
        record = orjson.loads(value)
        text = value.decode()
    except ValueError as cause:
        raise Unreadable(f"the value is no JSON ({cause})") from cause
    if not isinstance(record, dict) or not record:
        raise Unreadable("the value is no JSON object")
    if text[0] != "{" or text[-1] != "}":
        text = orjson.dumps(record).decode()
    return record, text


def _str(record: dict[str, Any], name: str, limit: int = _IDENTIFIER) -> str:
    value = record[name]
    if not isinstance(value, str) or len(value) > limit or "\x00" in value:
        raise TypeError(f"{name} is no text of at most {limit} characters")
    return value


def _int(record: dict[str, Any], name: str) -> int:
    value = record[name]
    if type(value) is not int or abs(value) >= 1 << 63:
        raise TypeError(f"{name} is no integer")
    return value


def _maybe_int(record: dict[str, Any], name: str) -> int | None:
    return _int(record, name) if name in record else None


def _same(record: dict[str, Any], name: str, expected: str) -> str:
    if record[name] != expected:
        raise ValueError(f"{name} is not that of the key")
    return expected


def _pad(record: dict[str, Any], names: Key, _place: _Place) -> Row:
    return {
        "pad_id": _same(record, "pad_id", names[0]),
        "msp_id": _str(record, "msp_id"),
        "status": _str(record, "status", 16),
    }


def _drone(record: dict[str, Any], names: Key, _place: _Place) -> Row:
    return {
        "uav_id": _same(record, "uav_id", names[0]),
        "msp_id": _str(record, "msp_id"),
        "status": _str(record, "status", 16),
    }


def _authorisation(record: dict[str, Any], names: Key, _place: _Place) -> Row:
    return {
        "uav_id": _same(record, "uav_id", names[0]),
        "authorisation_id": _same(record, "authorisation_id", names[1]),
    }


def _policy(_record: dict[str, Any], names: Key, _place: _Place) -> Row:
    if len(names[1]) > 16:
        raise ValueError("the key's action is no action")
    return {"pad_id": names[0], "action": names[1]}


def _closures(record: dict[str, Any], names: Key, _place: _Place) -> Row:
    return {
        "pad_id": _same(record, "pad_id", names[0]),
        "valid_until_ms": _int(record, "valid_until_ms"),
    }


def _session(record: dict[str, Any], names: Key, place: _Place) -> Row:
    state = _str(record, "state", 16)
    return {
        "session_id": _session_id(record, names),
        "pad_id": _str(record, "pad_id"),
        "uav_id": _str(record, "uav_id"),
        "action": _str(record, "action", 16),
        "state": state,
        "requested_ms": _int(record, "requested_ms"),
        "expires_ms": _int(record, "expires_ms"),
        "decided_ms": _maybe_int(record, "decided_ms"),
        "ended_ms": _maybe_int(record, "ended_ms"),
        "end": _str(record, "end", 64) if "end" in record else None,
        "verdict_tx": place.tx_id if state == "decided" else None,
        "complete_tx": place.tx_id if state in {"completed", "cancelled"} else None,
    }


def _verdict(record: dict[str, Any], names: Key, place: _Place) -> Row:
    return {
        "session_id": _session_id(record, names),
        "pad_id": _str(record, "pad_id"),
        "uav_id": _str(record, "uav_id"),
        "action": _str(record, "action", 16),
        "outcome": _str(record, "outcome", 16),
        "permission": _str(record, "permission", 16),
        "rounds": _int(record, "rounds"),
        "decided_ms": _int(record, "decided_ms"),
        "tx_id": place.tx_id,
    }


def _asset(record: dict[str, Any], names: Key, _place: _Place) -> Row:
    return {
        "id": _same(record, "id", names[0]),
        "type": _str(record, "type"),
        "owner_msp": _str(record, "owner_msp"),
        "owner": _str(record, "owner"),
    }


def _session_id(record: dict[str, Any], names: Key) -> str:
    session_id = _same(record, "session_id", names[0])
    if len(session_id) != 64:
        raise ValueError("session_id is no transaction id")
    return session_id


def _evidence(place: _Place, args: tuple[bytes, ...], changes: Changes) -> None:
    """The argument of a valid SubmitProof is the evidence on which its verdict stands."""
    if len(args) != 2:
        raise Unreadable(f"{len(args) - 1} arguments, not one")
    try:
        argument = orjson.loads(args[1])
        session_id = _str(argument, "session_id", 64)
        evidence = argument["evidence"]
        steps = [{"step": _str(each, "step", 16), "t_ms": _int(each, "t_ms")} for each in evidence["steps"]]
    except (KeyError, TypeError, ValueError) as cause:
        raise Unreadable(f"the argument is no evidence ({type(cause).__name__} {cause})") from cause
    row = {
        "session_id": session_id,
        "steps": orjson.dumps(steps).decode(),
        # The canonical form (all keys are ASCII): what the verdict's evidence_sha256 is of.
        "record": orjson.dumps(evidence, option=orjson.OPT_SORT_KEYS).decode(),
        "block": place.block,
        "tx_index": place.tx_index,
    }
    changes.put(EvidenceRow, (session_id,), row)


def _unread(changes: Changes, place: _Place, position: int, problem: str, *, namespace: str, key: str) -> None:
    changes.unread.append(
        {
            "block": place.block,
            "tx_index": place.tx_index,
            "position": position,
            "namespace": _text(namespace)[:_IDENTIFIER],
            "key": _text(key),
            "problem": _text(problem)[:_PROBLEM],
        }
    )


def _transaction_row(number: int, transaction: Transaction) -> Row:
    invocation = transaction.invocation
    creator = transaction.creator
    name = fingerprint = ""
    if creator is not None:
        fingerprint = creator.certificate_sha256
        try:
            name = creator.common_name
        except LedgerError:  # a refused transaction's certificate may be anything
            name = ""
    return {
        "block": number,
        "tx_index": transaction.index,
        "tx_id": _text(transaction.tx_id)[:_IDENTIFIER],
        "type": transaction.type.value,
        "validation_code": transaction.validation_code,
        "t_ms": transaction.timestamp_ms,
        "chaincode": _text(invocation.chaincode)[:_IDENTIFIER] if invocation is not None else "",
        "function": _text(invocation.function)[:_IDENTIFIER] if invocation is not None else "",
        "creator_msp": _text(creator.msp_id)[:_IDENTIFIER] if creator is not None else "",
        "creator_name": _text(name)[:_IDENTIFIER],
        "creator_certificate_sha256": fingerprint,
        "endorsers": _text(",".join(sorted({each.msp_id for each in transaction.endorsers}))),
    }


def _organisation_rows(config: ChannelConfig, number: int, tx_index: int) -> list[Row]:
    rows = []
    for msp_id, each in sorted(config.organisations.items()):
        definition = {
            "sections": list(each.sections),
            "root_certs": [_text(pem) for pem in each.root_certs],
            "intermediate_certs": [_text(pem) for pem in each.intermediate_certs],
            "revocation_lists": [_text(pem) for pem in each.revocation_lists],
            "node_ous": dict(sorted(each.node_ous.items())),
        }
        rows.append(
            {
                "msp_id": msp_id[:_IDENTIFIER],
                "definition": orjson.dumps(definition).decode(),
                "block": number,
                "tx_index": tx_index,
            }
        )
    return rows


def _text(value: str | bytes) -> str:
    """Text that every database takes: no NUL, no broken UTF-8."""
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    elif not value.isascii():
        value = value.encode(errors="replace").decode()
    return value.replace("\x00", "\ufffd") if "\x00" in value else value


_Reader = tuple[type[LedgerRow], int, Callable[[dict[str, Any], Key, _Place], Row]]
_READERS: Final[dict[str, _Reader]] = {
    keys.PAD: (PadRow, 1, _pad),
    keys.UAV: (DroneRow, 1, _drone),
    keys.AUTHORISATION: (AuthorisationRow, 2, _authorisation),
    keys.POLICY: (PolicyRow, 2, _policy),
    keys.CLOSURES: (ClosuresRow, 1, _closures),
    keys.SESSION: (SessionRow, 1, _session),
    keys.VERDICT: (VerdictRow, 1, _verdict),
    keys.ASSET: (AssetRow, 1, _asset),
}
_WITHOUT_ROWS: Final = frozenset({keys.PREKEY, keys.USED_PREKEY, keys.LAST_REQUEST, keys.TESTIMONY})
"""Secrets' public halves and their tombstones, and the times of requests: of use on the ledger only. What a witness
brought is judged in the verdict, which says so; its transaction is there in full."""

VERSIONED: Final = frozenset({keys.PAD, keys.UAV, keys.AUTHORISATION, keys.POLICY, keys.CLOSURES})
"""Kinds whose every version is kept."""

APPENDED: Final[tuple[tuple[type[LedgerRow], str], ...]] = (
    (BlockRow, "blocks"),
    (TransactionRow, "transactions"),
    (EventRow, "events"),
    (UnreadRow, "unread"),
    (RecordVersionRow, "versions"),
)
"""Tables that only grow, with the list of `Changes` that holds their rows."""
REPLACED: Final = OrganisationRow
