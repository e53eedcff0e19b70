"""All tables. Those with base `LedgerRow` are written by the mirror alone and can be rebuilt from block 0.

A record's columns are what queries filter and sort by; the record itself stands in ``record`` exactly as the ledger
has it (canonical JSON). ``block`` and ``tx_index`` say which transaction wrote the row last.
"""

from __future__ import annotations

from sqlalchemy import BigInteger, ForeignKeyConstraint, Index, Integer, MetaData, String, Text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}

Hash = String(64)
Identifier = String(128)
RowId = BigInteger().with_variant(Integer, "sqlite")  # SQLite numbers rows by itself only for INTEGER


class Base(DeclarativeBase):
    """Base of all tables."""

    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map = {int: BigInteger, str: Text}  # noqa: RUF012 - declared so by SQLAlchemy


class LedgerRow(Base):
    """Base of the tables that are derived from the ledger, and from nothing else."""

    __abstract__ = True


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


class OrganisationRow(LedgerRow):
    """Whom the channel trusts, from its latest configuration: an organisation's MSP."""

    __tablename__ = "organisations"

    msp_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    definition: Mapped[str]
    """JSON: sections, root_certs, intermediate_certs, revocation_lists (PEM), node_ous."""
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


class UnreadRow(LedgerRow):
    """A write that this version of the backend cannot read: kept and counted, never dropped without a word."""

    __tablename__ = "unread_writes"

    block: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tx_index: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    position: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    namespace: Mapped[str] = mapped_column(Identifier)
    key: Mapped[str]
    problem: Mapped[str]


class SpoolRow(Base):
    """How far an agent's spool has been taken in, durably."""

    __tablename__ = "spools"

    agent: Mapped[str] = mapped_column(String(8), primary_key=True)
    agent_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    spool: Mapped[str] = mapped_column(String(64), primary_key=True)
    acknowledged: Mapped[int]
    first_seen_ms: Mapped[int]
    last_seen_ms: Mapped[int]


class StepRow(Base):
    """A step of a session, as an agent reported it."""

    __tablename__ = "reported_steps"

    session_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    step: Mapped[str] = mapped_column(String(16), primary_key=True)
    agent: Mapped[str] = mapped_column(String(8), primary_key=True)
    agent_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    uav_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int]
    ok: Mapped[bool]
    detail: Mapped[str | None]


class SessionEndRow(Base):
    """How a session ended, as an agent reported it."""

    __tablename__ = "reported_ends"

    session_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    agent: Mapped[str] = mapped_column(String(8), primary_key=True)
    agent_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    t_ms: Mapped[int]
    body: Mapped[str]


class TrackRow(Base):
    """A Remote ID position that a pad heard. Unverified."""

    __tablename__ = "tracks"
    __table_args__ = (Index(None, "uav_id", "t_ms"), Index(None, "t_ms"))

    id: Mapped[int] = mapped_column(RowId, primary_key=True)
    uav_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int]
    body: Mapped[str]


class FindingRow(Base):
    """Something odd about a drone's broadcasts, as a pad's receiver saw it. Unverified."""

    __tablename__ = "findings"
    __table_args__ = (Index(None, "uav_id", "t_ms"), Index(None, "pad_id", "t_ms"), Index(None, "t_ms"))

    id: Mapped[int] = mapped_column(RowId, primary_key=True)
    uav_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    kind: Mapped[str] = mapped_column(String(32))
    t_ms: Mapped[int]
    body: Mapped[str]


class LatestTrackRow(Base):
    """The last position heard of each drone. Unverified."""

    __tablename__ = "latest_tracks"

    uav_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int] = mapped_column(index=True)
    body: Mapped[str]


class EstimateRow(Base):
    """A pad's running estimate during a session. Unverified."""

    __tablename__ = "estimates"
    __table_args__ = (Index(None, "session_id", "t_ms"), Index(None, "t_ms"))

    id: Mapped[int] = mapped_column(RowId, primary_key=True)
    session_id: Mapped[str] = mapped_column(Hash)
    uav_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int]
    body: Mapped[str]


class HealthRow(Base):
    """The last health report of each agent."""

    __tablename__ = "health"

    agent: Mapped[str] = mapped_column(String(8), primary_key=True)
    agent_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    t_ms: Mapped[int]
    body: Mapped[str]


class IrregularRow(Base):
    """A record that was rejected, or a gap that an agent declared (kind ``dropped``)."""

    __tablename__ = "irregular_records"
    __table_args__ = (
        ForeignKeyConstraint(
            ["agent", "agent_id", "spool"], ["spools.agent", "spools.agent_id", "spools.spool"], ondelete="CASCADE"
        ),
        Index(None, "received_ms"),
    )

    agent: Mapped[str] = mapped_column(String(8), primary_key=True)
    agent_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    spool: Mapped[str] = mapped_column(String(64), primary_key=True)
    seq: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    kind: Mapped[str] = mapped_column(String(32))
    code: Mapped[str] = mapped_column(String(32))
    message: Mapped[str]
    body: Mapped[str]
    received_ms: Mapped[int]


class AlertRow(Base):
    """Something that an officer must not miss, and what has become of it."""

    __tablename__ = "alerts"
    __table_args__ = (
        Index(None, "state", "t_ms"),
        Index(None, "t_ms", "alert_id"),
        Index(None, "pad_id", "t_ms"),
        Index(None, "uav_id", "t_ms"),
    )

    alert_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    kind: Mapped[str] = mapped_column(String(32))
    severity: Mapped[str] = mapped_column(String(16))
    source: Mapped[str]
    t_ms: Mapped[int]
    pad_id: Mapped[str | None] = mapped_column(Identifier)
    uav_id: Mapped[str | None] = mapped_column(Identifier)
    session_id: Mapped[str | None] = mapped_column(Hash)
    tx_id: Mapped[str | None] = mapped_column(Identifier)
    facts: Mapped[str]
    """JSON object: what its text needs."""
    state: Mapped[str] = mapped_column(String(16))
    """``open``, ``acknowledged`` or ``over`` (its cause has ended by itself)."""
    revision: Mapped[int]
    """Rises with each change; who acts names the one that he has seen."""
    changed_ms: Mapped[int] = mapped_column(index=True)
    acknowledged_by: Mapped[str | None] = mapped_column(Identifier)
    assigned_to: Mapped[str | None] = mapped_column(Identifier)
    snoozed_until_ms: Mapped[int | None]
    over_ms: Mapped[int | None]


class AlertActRow(Base):
    """What somebody did about an alert. Never changed, never deleted."""

    __tablename__ = "alert_acts"

    alert_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    revision: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    t_ms: Mapped[int]
    person: Mapped[str] = mapped_column(Identifier)
    act: Mapped[str] = mapped_column(String(16))
    detail: Mapped[str | None] = mapped_column(Identifier)
    """Whom it was assigned to, or until when (ms) it sleeps."""
    note: Mapped[str | None]


class AlertDeliveryRow(Base):
    """An alert that is to be told to somebody outside: by e-mail or webhook, until it has been."""

    __tablename__ = "alert_deliveries"

    alert_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    target: Mapped[str] = mapped_column(String(512), primary_key=True)
    attempts: Mapped[int]
    next_ms: Mapped[int | None] = mapped_column(index=True)
    """When to try (again); None when it is delivered or given up."""
    delivered_ms: Mapped[int | None]
    problem: Mapped[str | None]


class SignInTokenRow(Base):
    """A one-time token that lets one browser sign in. Only its hash is kept."""

    __tablename__ = "sign_in_tokens"

    token_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    name: Mapped[str] = mapped_column(Identifier)
    roles: Mapped[str]
    created_ms: Mapped[int]
    expires_ms: Mapped[int]
    used_ms: Mapped[int | None]


class SignInRow(Base):
    """A signed-in browser. Only the hash of its cookie is kept."""

    __tablename__ = "sign_ins"

    cookie_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    name: Mapped[str] = mapped_column(Identifier)
    roles: Mapped[str]
    method: Mapped[str] = mapped_column(String(32))
    created_ms: Mapped[int]
    expires_ms: Mapped[int] = mapped_column(index=True)
    last_seen_ms: Mapped[int]


class InstanceRow(Base):
    """This installation: an identifier that names its cookie, so that two on one host do not share one."""

    __tablename__ = "instance"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    instance: Mapped[str] = mapped_column(String(32))
    created_ms: Mapped[int]


def ledger_tables() -> tuple[type[LedgerRow], ...]:
    """The tables that the mirror writes, by name."""
    found = [each for each in LedgerRow.__subclasses__() if not each.__dict__.get("__abstract__")]
    return tuple(sorted(found, key=lambda each: each.__tablename__))
