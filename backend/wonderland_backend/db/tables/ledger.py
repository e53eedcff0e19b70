"""What the mirror has read from the ledger.

A record's columns are what queries filter and sort by; the record itself stands in ``record`` exactly as the ledger
has it (canonical JSON). ``block`` and ``tx_index`` say which transaction wrote the row last.
"""

from __future__ import annotations

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Hash, Identifier, LedgerRow


class Checkpoint(LedgerRow):
    """How far the mirror has come: the last block whose rows are here. One row, one channel."""

    __tablename__ = "checkpoint"

    channel: Mapped[str] = mapped_column(Identifier, primary_key=True)
    block: Mapped[int]
    header_hash: Mapped[str] = mapped_column(Hash)
    data_hash: Mapped[str] = mapped_column(Hash)
    previous_hash: Mapped[str] = mapped_column(Hash)


class BlockRow(LedgerRow):
    """A block's header and what it holds."""

    __tablename__ = "blocks"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    header_hash: Mapped[str] = mapped_column(Hash)
    previous_hash: Mapped[str] = mapped_column(Hash)
    data_hash: Mapped[str] = mapped_column(Hash)
    t_ms: Mapped[int]
    transactions: Mapped[int]
    valid: Mapped[int]
    size_bytes: Mapped[int]


class TransactionRow(LedgerRow):
    """A transaction, valid or not."""

    __tablename__ = "transactions"

    block: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tx_index: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tx_id: Mapped[str] = mapped_column(Identifier, index=True)
    type: Mapped[str] = mapped_column(String(16))
    validation_code: Mapped[int]
    t_ms: Mapped[int]
    chaincode: Mapped[str] = mapped_column(Identifier)
    function: Mapped[str] = mapped_column(Identifier)
    creator_msp: Mapped[str] = mapped_column(Identifier)
    creator_name: Mapped[str] = mapped_column(Identifier)
    creator_certificate_sha256: Mapped[str] = mapped_column(Hash)
    endorsers: Mapped[str]
    """MSP ids of those who endorsed, comma-separated."""


class EventRow(LedgerRow):
    """The event of a valid transaction."""

    __tablename__ = "events"

    block: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tx_index: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    name: Mapped[str] = mapped_column(Identifier, index=True)
    payload: Mapped[str]


class EndorsementPolicyRow(LedgerRow):
    """Who must endorse changes of a record, or calls of a contract: what the next blocks are checked against."""

    __tablename__ = "endorsement_policies"

    key_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    """Of namespace and key, which may hold octets that databases do not take."""
    policy: Mapped[str]
    """Base64 of the policy's protocol buffer."""
    block: Mapped[int]
    tx_index: Mapped[int]


class OrganisationRow(LedgerRow):
    """Whom the channel trusts, from its latest configuration: an organisation's MSP."""

    __tablename__ = "organisations"

    msp_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    definition: Mapped[str]
    """JSON: sections, root_certs, intermediate_certs, tls_root_certs, revocation_lists (PEM), node_ous."""
    block: Mapped[int]
    tx_index: Mapped[int]


class PadRow(LedgerRow):
    """A landing pad."""

    __tablename__ = "pads"

    pad_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    msp_id: Mapped[str] = mapped_column(Identifier)
    status: Mapped[str] = mapped_column(String(16))
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class DroneRow(LedgerRow):
    """A drone."""

    __tablename__ = "drones"

    uav_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    msp_id: Mapped[str] = mapped_column(Identifier)
    status: Mapped[str] = mapped_column(String(16))
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class AuthorisationRow(LedgerRow):
    """What a drone may do at a pad, and when."""

    __tablename__ = "authorisations"

    uav_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    authorisation_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class PolicyRow(LedgerRow):
    """The policy of a pad (or *) and an action (or *)."""

    __tablename__ = "policies"

    pad_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    action: Mapped[str] = mapped_column(String(16), primary_key=True)
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class ChangeRow(LedgerRow):
    """A change that two people make: proposed, and what became of it."""

    __tablename__ = "changes"
    __table_args__ = (Index(None, "block", "tx_index"),)

    change_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    state: Mapped[str] = mapped_column(String(16))
    expires_ms: Mapped[int]
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class ClosuresRow(LedgerRow):
    """When zones forbid what at a pad."""

    __tablename__ = "closures"

    pad_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    valid_until_ms: Mapped[int]
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class ReservationsRow(LedgerRow):
    """For whom a pad is kept, and when."""

    __tablename__ = "reservations"

    pad_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class CertificateRow(LedgerRow):
    """A certificate that signed or endorsed a valid transaction, and where it did so last (`block`, `tx_index`)."""

    __tablename__ = "certificates"
    __table_args__ = (Index(None, "msp_id", "name"), Index(None, "not_after_ms"))

    certificate_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    msp_id: Mapped[str] = mapped_column(Identifier)
    name: Mapped[str] = mapped_column(Identifier)
    node_ou: Mapped[str] = mapped_column(String(16))
    role: Mapped[str] = mapped_column(Identifier)
    pol_id: Mapped[str] = mapped_column(Identifier)
    serial: Mapped[str] = mapped_column(String(64))
    """Hexadecimal."""
    not_before_ms: Mapped[int]
    not_after_ms: Mapped[int]
    block: Mapped[int]
    tx_index: Mapped[int]


class SessionRow(LedgerRow):
    """A session, with what lists show of its verdict. ``evidence`` is what the pad brought, if it did."""

    __tablename__ = "sessions"
    __table_args__ = (
        Index(None, "requested_ms", "session_id"),
        Index(None, "pad_id", "requested_ms"),
        Index(None, "uav_id", "requested_ms"),
        Index(None, "state", "requested_ms"),
    )

    session_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    pad_id: Mapped[str] = mapped_column(Identifier)
    uav_id: Mapped[str] = mapped_column(Identifier)
    action: Mapped[str] = mapped_column(String(16))
    state: Mapped[str] = mapped_column(String(16))
    requested_ms: Mapped[int]
    expires_ms: Mapped[int]
    decided_ms: Mapped[int | None]
    ended_ms: Mapped[int | None]
    end: Mapped[str | None] = mapped_column(String(64))
    verdict_tx: Mapped[str | None] = mapped_column(Identifier)
    complete_tx: Mapped[str | None] = mapped_column(Identifier)
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class EvidenceRow(LedgerRow):
    """The evidence that a pad brought before the contract, from the argument of its SubmitProof."""

    __tablename__ = "evidence"

    session_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    steps: Mapped[str]
    """The evidence's own list of steps, for lists that do not need the ranges."""
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class VerdictRow(LedgerRow):
    """A verdict. Only the mirror writes here, from a valid, committed transaction."""

    __tablename__ = "verdicts"
    __table_args__ = (
        Index(None, "block", "tx_index"),
        Index(None, "pad_id", "block"),
        Index(None, "uav_id", "block"),
        Index(None, "outcome", "block"),
        Index(None, "decided_ms"),
    )

    session_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    pad_id: Mapped[str] = mapped_column(Identifier)
    uav_id: Mapped[str] = mapped_column(Identifier)
    action: Mapped[str] = mapped_column(String(16))
    outcome: Mapped[str] = mapped_column(String(16))
    permission: Mapped[str] = mapped_column(String(16))
    rounds: Mapped[int]
    decided_ms: Mapped[int]
    tx_id: Mapped[str] = mapped_column(Identifier)
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class AssetRow(LedgerRow):
    """A value of any type (the paper's generic data structure)."""

    __tablename__ = "assets"

    id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    type: Mapped[str] = mapped_column(Identifier, index=True)
    owner_msp: Mapped[str] = mapped_column(Identifier)
    owner: Mapped[str] = mapped_column(Identifier)
    record: Mapped[str]
    block: Mapped[int]
    tx_index: Mapped[int]


class RecordVersionRow(LedgerRow):
    """Every version of every pad, drone, authorisation, policy and closures: what held when, and who changed what."""

    __tablename__ = "record_versions"
    __table_args__ = (Index(None, "kind", "block"),)

    kind: Mapped[str] = mapped_column(String(16), primary_key=True)
    """``pad``, ``uav``, ``authorisation``, ``policy`` or ``closures``."""
    key: Mapped[str] = mapped_column(Identifier, primary_key=True)
    """The parts of the record's key on the ledger, joined by ``/``."""
    block: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tx_index: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    record: Mapped[str]


class UnreadRow(LedgerRow):
    """A write that this version of the backend cannot read: kept and counted, never dropped without a word."""

    __tablename__ = "unread_writes"

    block: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tx_index: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    position: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    namespace: Mapped[str] = mapped_column(Identifier)
    key: Mapped[str]
    problem: Mapped[str]


def ledger_tables() -> tuple[type[LedgerRow], ...]:
    """The tables that the mirror writes, by name."""
    found = [each for each in LedgerRow.__subclasses__() if not each.__dict__.get("__abstract__")]
    return tuple(sorted(found, key=lambda each: each.__tablename__))
