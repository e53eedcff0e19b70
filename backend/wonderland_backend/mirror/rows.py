"""Rows of the tables that are derived from the ledger, as they go from a block to the database and the live side.

The fields of a record's row that are columns of their own say, with their bounds, which records this version can read.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, ClassVar, Final, NamedTuple, Self

import msgspec
import orjson

from wonderland.proofs.records import keys
from wonderland_backend.db.tables import ledger as tables
from wonderland_backend.db.tables.base import LedgerRow

Key = tuple[str, ...]
Table = type[LedgerRow]

_TEXT: Final = r"^[^\x00]*$"  # no NUL, which databases would not take
Identifier = Annotated[str, msgspec.Meta(max_length=128, pattern=_TEXT)]
Word = Annotated[str, msgspec.Meta(max_length=16, pattern=_TEXT)]
SessionId = Annotated[str, msgspec.Meta(min_length=64, max_length=64, pattern=_TEXT)]
Number = Annotated[int, msgspec.Meta(gt=-(2**63), le=2**63 - 1)]

APPLICATION: Final = "Application"


class Place(NamedTuple):
    """Where a write stands."""

    block: int
    tx_index: int
    tx_id: str


class Row(msgspec.Struct):
    """A row of a table."""

    table: ClassVar[Table]


class BlockWrite(Row):
    """A block's header and what it holds."""

    table: ClassVar[Table] = tables.BlockRow
    number: int
    header_hash: str
    previous_hash: str
    data_hash: str
    t_ms: int
    transactions: int
    valid: int
    size_bytes: int


class TransactionWrite(Row):
    """A transaction, valid or not."""

    table: ClassVar[Table] = tables.TransactionRow
    block: int
    tx_index: int
    tx_id: str
    type: str
    validation_code: int
    t_ms: int
    chaincode: str
    function: str
    creator_msp: str
    creator_name: str
    creator_certificate_sha256: str
    endorsers: str


class EventWrite(Row):
    """The event of a valid transaction."""

    table: ClassVar[Table] = tables.EventRow
    block: int
    tx_index: int
    name: str
    payload: str


class UnreadWrite(Row):
    """A write that this version cannot read."""

    table: ClassVar[Table] = tables.UnreadRow
    block: int
    tx_index: int
    position: int
    namespace: str
    key: str
    problem: str


class VersionWrite(Row):
    """A version of a record."""

    table: ClassVar[Table] = tables.RecordVersionRow
    kind: str
    key: str
    block: int
    tx_index: int
    record: str


class EndorsementPolicyWrite(Row):
    """Who must endorse changes of a record."""

    table: ClassVar[Table] = tables.EndorsementPolicyRow
    key_sha256: str
    policy: str
    block: int
    tx_index: int


class OrganisationWrite(Row):
    """An organisation of the channel."""

    table: ClassVar[Table] = tables.OrganisationRow
    msp_id: str
    definition: str
    block: int
    tx_index: int


class CertificateWrite(Row):
    """A certificate, and where it signed or endorsed last."""

    table: ClassVar[Table] = tables.CertificateRow
    certificate_sha256: str
    msp_id: str
    name: str
    node_ou: str
    role: str
    pol_id: str
    serial: str
    not_before_ms: int
    not_after_ms: int
    block: int = -1
    tx_index: int = -1


class EvidenceWrite(Row):
    """What a pad brought before the contract."""

    table: ClassVar[Table] = tables.EvidenceRow
    session_id: str
    steps: str
    record: str = ""
    block: int = -1
    tx_index: int = -1


class RecordRow(Row, kw_only=True):
    """The row of a record: parsed from it, then told where it was written."""

    names: ClassVar[Key]
    """Its fields that make the key on the ledger."""
    record: str = ""
    block: int = -1
    tx_index: int = -1

    @classmethod
    def read(cls, record: dict[str, Any], key: Key) -> Self:
        """The row of a record that stands under this key. Raises `ValueError`."""
        row = msgspec.convert(record, cls)
        row.require_key(key)
        return row

    def require_key(self, key: Key) -> None:
        """Raise `ValueError` where the record says another key."""
        for name, expected in zip(self.names, key, strict=True):
            if getattr(self, name) != expected:
                raise ValueError(f"{name} is not that of the key")

    def written(self, record: str, place: Place) -> None:
        """The transaction that wrote it, and the record's text."""
        self.record, self.block, self.tx_index = record, place.block, place.tx_index


class PadWrite(RecordRow):
    """A landing pad."""

    table: ClassVar[Table] = tables.PadRow
    names: ClassVar[Key] = ("pad_id",)
    pad_id: Identifier
    msp_id: Identifier
    status: Word


class DroneWrite(RecordRow):
    """A drone."""

    table: ClassVar[Table] = tables.DroneRow
    names: ClassVar[Key] = ("uav_id",)
    uav_id: Identifier
    msp_id: Identifier
    status: Word


class AuthorisationWrite(RecordRow):
    """What a drone may do at a pad, and when."""

    table: ClassVar[Table] = tables.AuthorisationRow
    names: ClassVar[Key] = ("uav_id", "authorisation_id")
    uav_id: Identifier
    authorisation_id: Identifier


class PolicyWrite(RecordRow):
    """The policy of a pad and an action, which only its key names."""

    table: ClassVar[Table] = tables.PolicyRow
    names: ClassVar[Key] = ("pad_id", "action")
    pad_id: Identifier = ""
    action: Word = ""

    def require_key(self, key: Key) -> None:
        """Take the key's names. Raises `ValueError` for an action that is none."""
        self.pad_id, self.action = key
        if len(self.action) > 16:
            raise ValueError("the key's action is no action")


class ChangeWrite(RecordRow):
    """A change that two people make."""

    table: ClassVar[Table] = tables.ChangeRow
    names: ClassVar[Key] = ("change_id",)
    change_id: Identifier
    state: Word
    expires_ms: Number


class ClosuresWrite(RecordRow):
    """When zones forbid what at a pad."""

    table: ClassVar[Table] = tables.ClosuresRow
    names: ClassVar[Key] = ("pad_id",)
    pad_id: Identifier
    valid_until_ms: Number


class ReservationsWrite(RecordRow):
    """For whom a pad is kept, and when."""

    table: ClassVar[Table] = tables.ReservationsRow
    names: ClassVar[Key] = ("pad_id",)
    pad_id: Identifier


class SessionWrite(RecordRow):
    """A state of a session."""

    table: ClassVar[Table] = tables.SessionRow
    names: ClassVar[Key] = ("session_id",)
    session_id: SessionId
    pad_id: Identifier
    uav_id: Identifier
    action: Word
    state: Word
    requested_ms: Number
    expires_ms: Number
    decided_ms: Number | None = None
    ended_ms: Number | None = None
    end: Annotated[str, msgspec.Meta(max_length=64, pattern=_TEXT)] | None = None
    verdict_tx: str | None = None
    complete_tx: str | None = None

    def written(self, record: str, place: Place) -> None:
        """Besides: by which transaction it was decided or ended, if by this one."""
        RecordRow.written(self, record, place)
        self.verdict_tx = place.tx_id if self.state == "decided" else None
        # A departure is written into a session that had ended before. Within a text, the quote would be escaped.
        ended = self.state in {"completed", "cancelled"} and '"departure":{' not in record
        self.complete_tx = place.tx_id if ended else None

    def keep(self, before: SessionWrite) -> None:
        """What an earlier state of the session said of its transactions, and this one does not."""
        self.verdict_tx = self.verdict_tx or before.verdict_tx
        self.complete_tx = self.complete_tx or before.complete_tx


OUTLINE: Final = tuple(name for name in SessionWrite.__struct_fields__ if name not in RecordRow.__struct_fields__)
"""Columns of a session's row that its state shows."""


def outline_of(row: SessionWrite | tables.SessionRow) -> SessionWrite:
    """A session's state by itself, without its record."""
    return SessionWrite(*(getattr(row, name) for name in OUTLINE))


class VerdictWrite(RecordRow):
    """A verdict."""

    table: ClassVar[Table] = tables.VerdictRow
    names: ClassVar[Key] = ("session_id",)
    session_id: SessionId
    pad_id: Identifier
    uav_id: Identifier
    action: Word
    outcome: Word
    permission: Word
    rounds: Number
    decided_ms: Number
    tx_id: str = ""

    def written(self, record: str, place: Place) -> None:
        """Note the verdict's transaction, too: commit subscribers ask for it."""
        RecordRow.written(self, record, place)
        self.tx_id = place.tx_id


class AssetWrite(RecordRow):
    """A value of any type."""

    table: ClassVar[Table] = tables.AssetRow
    names: ClassVar[Key] = ("id",)
    id: Identifier
    type: Identifier
    owner_msp: Identifier
    owner: Identifier


RECORDS: Final[dict[str, type[RecordRow]]] = {
    keys.PAD: PadWrite,
    keys.UAV: DroneWrite,
    keys.AUTHORISATION: AuthorisationWrite,
    keys.POLICY: PolicyWrite,
    keys.CHANGE: ChangeWrite,
    keys.CLOSURES: ClosuresWrite,
    keys.RESERVATIONS: ReservationsWrite,
    keys.SESSION: SessionWrite,
    keys.VERDICT: VerdictWrite,
    keys.ASSET: AssetWrite,
}


def participants(organisations: Iterable[tuple[str, str]]) -> list[str]:
    """Which organisations, of (MSP id, definition) each, take part in the channel's transactions; by name."""
    return sorted(msp_id for msp_id, definition in organisations if APPLICATION in orjson.loads(definition)["sections"])
