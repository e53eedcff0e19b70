"""From a block to rows, without I/O: everything follows from the write sets of valid transactions.

A value whose form this version does not know becomes an `UnreadRow`, so that it is seen and counted, and the mirror
goes on: the chain itself is sound.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar, cast

import msgspec
import orjson

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records import keys
from wonderland.proofs.records.landings import Landing
from wonderland_backend.mirror.certificates import note_signers
from wonderland_backend.mirror.rows import (
    RECORDS,
    BlockWrite,
    CertificateWrite,
    EndorsementPolicyWrite,
    EventWrite,
    EvidenceWrite,
    Key,
    Number,
    OrganisationWrite,
    Place,
    Row,
    SessionId,
    SessionWrite,
    TransactionWrite,
    UnreadWrite,
    VerdictWrite,
    VersionWrite,
    Word,
)
from wonderland_fabric_gateway.blocks import Block, Transaction
from wonderland_fabric_gateway.channel_config import ChannelConfig
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.transactions import Invocation, Write
from wonderland_fabric_gateway.verification.light_client import policy_changes

R = TypeVar("R", bound=Row)

_SUBMIT_PROOF: Final = "SubmitProof"
_REPORT_LANDING: Final = "ReportLanding"
_IDENTIFIER: Final = 128
_PROBLEM: Final = 300

WITHOUT_ROWS: Final = frozenset(
    {keys.PREKEY, keys.USED_PREKEY, keys.LAST_REQUEST, keys.TESTIMONY, keys.AUDIT_LOG, keys.AUDIT_HEAD}
)
"""Secrets' public halves and their tombstones, and the times of requests: of use on the ledger only. What a witness
brought is judged in the verdict, which says so; its transaction is there in full. Heads of
audit logs are asked of the ledger itself: a copy of them beside the log would prove nothing."""
VERSIONED: Final = frozenset({keys.PAD, keys.UAV, keys.AUTHORISATION, keys.POLICY, keys.CLOSURES})
"""Kinds whose every version is kept."""


@dataclass(frozen=True)
class LandingTold:
    """A landing without a permission, by the transaction that reported it."""

    tx_id: str
    landing: Landing


@dataclass
class Changes:
    """Rows of some blocks in order: what to insert, what to upsert, what to delete; and what to tell the live side."""

    blocks: list[BlockWrite] = field(default_factory=list)
    transactions: list[TransactionWrite] = field(default_factory=list)
    events: list[EventWrite] = field(default_factory=list)
    unread: list[UnreadWrite] = field(default_factory=list)
    versions: list[VersionWrite] = field(default_factory=list)
    upserts: dict[type[Row], dict[Key, Row]] = field(default_factory=dict)
    deletes: dict[type[Row], set[Key]] = field(default_factory=dict)
    organisations: list[OrganisationWrite] | None = None
    """All of them, when a configuration came; it replaces the one before."""

    session_writes: list[SessionWrite] = field(default_factory=list)
    """Every state of every session, in order."""
    verdict_writes: list[VerdictWrite] = field(default_factory=list)
    landings: list[LandingTold] = field(default_factory=list)
    """Without a permission, as drones reported them; they have no rows."""

    @property
    def last(self) -> BlockWrite:
        """The last block's row."""
        return self.blocks[-1]

    @property
    def grown(self) -> tuple[Sequence[Row], ...]:
        """Rows of the tables that only grow."""
        return self.blocks, self.transactions, self.events, self.unread, self.versions

    def rows(self, kind: type[R]) -> dict[Key, R]:
        """What to upsert into one table."""
        return cast("dict[Key, R]", self.upserts.setdefault(kind, {}))

    def put(self, key: Key, row: Row) -> None:
        """Upsert a row; the last write of a key counts."""
        rows = self.rows(type(row))
        before = rows.get(key)
        if isinstance(row, SessionWrite) and isinstance(before, SessionWrite):
            row.keep(before)
        rows[key] = row
        self.deletes.get(type(row), set()).discard(key)

    def remove(self, kind: type[Row], key: Key) -> None:
        """Delete a row."""
        self.rows(kind).pop(key, None)
        self.deletes.setdefault(kind, set()).add(key)


class Unreadable(Exception):  # noqa: N818 - caught here and turned into a row
    """A value that has not the form this version knows."""


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
            note_signers(changes.rows(CertificateWrite), block.number, transaction)
    changes.blocks.append(
        BlockWrite(
            number=block.number,
            header_hash=block.header_hash.hex(),
            previous_hash=block.header.previous_hash.hex(),
            data_hash=block.header.data_hash.hex(),
            t_ms=t_ms,
            transactions=len(block.transactions),
            valid=valid,
            size_bytes=sum(map(len, block.envelopes)),
        )
    )


def _invocation(number: int, transaction: Transaction, chaincode: str, changes: Changes) -> None:
    place = Place(number, transaction.index, transaction.tx_id)
    event = transaction.event
    if event is not None:
        changes.events.append(
            EventWrite(
                block=number,
                tx_index=transaction.index,
                name=_text(event.name)[:_IDENTIFIER],
                payload=_text(event.payload),
            )
        )
    for position, (namespace, write) in enumerate(transaction.writes):
        if namespace != chaincode:
            continue
        try:
            _write(place, write, changes)
        except Unreadable as problem:
            _unread(changes, place, position, str(problem), namespace=namespace, key=write.key)
    assert transaction.invocation is not None
    _policies(place, transaction.invocation, changes)
    if transaction.invocation.chaincode != chaincode:
        return
    if transaction.invocation.function == _REPORT_LANDING and event is not None:
        try:
            changes.landings.append(LandingTold(transaction.tx_id, _landing(event.payload)))
        except Unreadable as problem:
            _unread(changes, place, -1, str(problem), namespace=chaincode, key=_REPORT_LANDING)
    if transaction.invocation.function == _SUBMIT_PROOF:
        try:
            _evidence(place, transaction.invocation.args, changes)
        except Unreadable as problem:
            _unread(changes, place, -1, str(problem), namespace=chaincode, key=_SUBMIT_PROOF)


def _landing(payload: bytes) -> Landing:
    try:
        return Landing.parse(orjson.loads(payload)["record"])
    except (ValueError, KeyError, TypeError, ProofError) as problem:
        raise Unreadable(f"the event of a landing: {problem}") from problem


def _policies(place: Place, invocation: Invocation, changes: Changes) -> None:
    try:
        for key, policy in policy_changes(invocation):
            if policy is None:
                changes.remove(EndorsementPolicyWrite, (key.hex(),))
            else:
                row = EndorsementPolicyWrite(key.hex(), b64encode(policy).decode(), place.block, place.tx_index)
                changes.put((key.hex(),), row)
    except LedgerError as problem:
        _unread(changes, place, -1, str(problem), namespace=invocation.chaincode, key="endorsement policy")


def _write(place: Place, write: Write, changes: Changes) -> None:
    kind, names = keys.split(write.key)
    if kind in WITHOUT_ROWS:
        return
    row_of = RECORDS.get(kind)
    if row_of is None:
        raise Unreadable(f"no such kind of record: {kind!r}" if kind else "not a composite key")
    width = len(row_of.names)
    if len(names) != width or any(not 0 < len(name) <= _IDENTIFIER for name in names):
        raise Unreadable(f"a key of {kind} has {width} parts of 1 to {_IDENTIFIER} characters")
    if write.is_delete:
        changes.remove(row_of, names)
        return
    record, text = _parse(write.value)
    try:
        row = row_of.read(record, names)
    except ValueError as cause:
        raise Unreadable(f"{kind}: {cause}") from cause
    row.written(text, place)
    changes.put(names, row)
    if isinstance(row, SessionWrite):
        changes.session_writes.append(row)
    elif isinstance(row, VerdictWrite):
        changes.verdict_writes.append(row)
    elif kind in VERSIONED:
        changes.versions.append(
            VersionWrite(
                kind=kind,
                key="/".join(names)[:_IDENTIFIER],
                block=place.block,
                tx_index=place.tx_index,
                record=text,
            )
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


class _Step(msgspec.Struct):
    step: Word
    t_ms: Number


class _Evidence(msgspec.Struct):
    steps: list[_Step]


class _SubmitProof(msgspec.Struct):
    session_id: SessionId
    evidence: _Evidence


def _evidence(place: Place, args: tuple[bytes, ...], changes: Changes) -> None:
    """The argument of a valid SubmitProof is the evidence on which its verdict stands."""
    if len(args) != 2:
        raise Unreadable(f"{len(args) - 1} arguments, not one")
    try:
        argument = orjson.loads(args[1])
        said = msgspec.convert(argument, _SubmitProof)
    except ValueError as cause:
        raise Unreadable(f"the argument is no evidence ({cause})") from cause
    row = EvidenceWrite(
        session_id=said.session_id,
        steps=msgspec.json.encode(said.evidence.steps).decode(),
        # The canonical form (all keys are ASCII): what the verdict's evidence_sha256 is of.
        record=orjson.dumps(argument["evidence"], option=orjson.OPT_SORT_KEYS).decode(),
        block=place.block,
        tx_index=place.tx_index,
    )
    changes.put((said.session_id,), row)


def _unread(changes: Changes, place: Place, position: int, problem: str, *, namespace: str, key: str) -> None:
    changes.unread.append(
        UnreadWrite(
            block=place.block,
            tx_index=place.tx_index,
            position=position,
            namespace=_text(namespace)[:_IDENTIFIER],
            key=_text(key),
            problem=_text(problem)[:_PROBLEM],
        )
    )


def _transaction_row(number: int, transaction: Transaction) -> TransactionWrite:
    invocation = transaction.invocation
    creator = transaction.creator
    name = fingerprint = ""
    if creator is not None:
        fingerprint = creator.certificate_sha256
        try:
            name = creator.common_name
        except LedgerError:  # a refused transaction's certificate may be anything
            name = ""
    return TransactionWrite(
        block=number,
        tx_index=transaction.index,
        tx_id=_text(transaction.tx_id)[:_IDENTIFIER],
        type=transaction.type.value,
        validation_code=transaction.validation_code,
        t_ms=transaction.timestamp_ms,
        chaincode=_text(invocation.chaincode)[:_IDENTIFIER] if invocation is not None else "",
        function=_text(invocation.function)[:_IDENTIFIER] if invocation is not None else "",
        creator_msp=_text(creator.msp_id)[:_IDENTIFIER] if creator is not None else "",
        creator_name=_text(name)[:_IDENTIFIER],
        creator_certificate_sha256=fingerprint,
        endorsers=_text(",".join(sorted({each.msp_id for each in transaction.endorsers}))),
    )


def _organisation_rows(config: ChannelConfig, number: int, tx_index: int) -> list[OrganisationWrite]:
    rows = []
    for msp_id, each in sorted(config.organisations.items()):
        definition = {
            "sections": list(each.sections),
            "root_certs": [_text(pem) for pem in each.root_certs],
            "intermediate_certs": [_text(pem) for pem in each.intermediate_certs],
            "tls_root_certs": [_text(pem) for pem in each.tls_root_certs],
            "revocation_lists": [_text(pem) for pem in each.revocation_lists],
            "node_ous": dict(sorted(each.node_ous.items())),
        }
        rows.append(
            OrganisationWrite(
                msp_id=msp_id[:_IDENTIFIER],
                definition=orjson.dumps(definition).decode(),
                block=number,
                tx_index=tx_index,
            )
        )
    return rows


def _text(value: str | bytes) -> str:
    """Text that every database takes: no NUL, no broken UTF-8."""
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    elif not value.isascii():
        value = value.encode(errors="replace").decode()
    return value.replace("\x00", "\ufffd") if "\x00" in value else value
