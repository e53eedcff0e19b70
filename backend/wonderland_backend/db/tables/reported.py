"""What agents reported, all of it unverified, and this installation itself.

`received_ms` is this server's clock when the row was written: what was known at a moment is what had been received by
then, whatever the agents' own clocks said. Tables with many rows are partitioned by it, by day, on PostgreSQL
(`wonderland_backend.db.partitions`).
"""

from __future__ import annotations

from sqlalchemy import ForeignKeyConstraint, Index, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier, RowId


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
    """A step of a session, as an agent reported it. Reported again, it stands twice: the later one counts."""

    __tablename__ = "reported_steps"
    __table_args__ = (Index(None, "received_ms"),)

    session_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    step: Mapped[str] = mapped_column(String(16), primary_key=True)
    agent: Mapped[str] = mapped_column(String(8), primary_key=True)
    agent_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    received_ms: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
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
    received_ms: Mapped[int]
    body: Mapped[str]


class TrackRow(Base):
    """A Remote ID position that a pad heard. Unverified. Partitioned."""

    __tablename__ = "tracks"
    # With the id, the newest position is the first in the index: nothing has to be sorted.
    __table_args__ = (Index(None, "uav_id", "t_ms", "received_ms", "id"), Index(None, "received_ms"))

    id: Mapped[int] = mapped_column(RowId, primary_key=True)
    uav_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int]
    received_ms: Mapped[int]
    body: Mapped[str]


class TrackMinuteRow(Base):
    """How many positions were received in a minute, so that nobody has to count them."""

    __tablename__ = "track_minutes"

    minute_ms: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    positions: Mapped[int]


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


class BroadcastOperatorRow(Base):
    """Whose number each drone broadcasts: personal data, which its positions do not repeat. Unverified."""

    __tablename__ = "broadcast_operators"

    uav_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    operator_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int] = mapped_column(index=True)


class EstimateRow(Base):
    """A pad's running estimate during a session. Unverified. Partitioned."""

    __tablename__ = "estimates"
    __table_args__ = (Index(None, "session_id", "received_ms"), Index(None, "received_ms"))

    id: Mapped[int] = mapped_column(RowId, primary_key=True)
    session_id: Mapped[str] = mapped_column(Hash)
    uav_id: Mapped[str] = mapped_column(Identifier)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int]
    received_ms: Mapped[int]
    body: Mapped[str]


class PadHealthRow(Base):
    """Every health report of every pad. Partitioned."""

    __tablename__ = "pad_health"
    __table_args__ = (Index(None, "pad_id", "received_ms"), Index(None, "received_ms"))

    id: Mapped[int] = mapped_column(RowId, primary_key=True)
    pad_id: Mapped[str] = mapped_column(Identifier)
    t_ms: Mapped[int]
    received_ms: Mapped[int]
    body: Mapped[str]


class PadConnectionRow(Base):
    """From when until when a pad's agent was connected to a server.

    `until_ms` is moved on while the connection stands: it tells what a server that died could not write down.
    """

    __tablename__ = "pad_connections"
    __table_args__ = (Index(None, "from_ms"), Index(None, "until_ms"))

    pad_id: Mapped[str] = mapped_column(Identifier, primary_key=True)
    server: Mapped[str] = mapped_column(String(32), primary_key=True)
    """The server's run (its epoch)."""
    from_ms: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    until_ms: Mapped[int]
    ended: Mapped[bool]


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


class BlockArrivalRow(Base):
    """When this installation came to know a block. It stays when the mirror's rows are rebuilt."""

    __tablename__ = "block_arrivals"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    known_ms: Mapped[int] = mapped_column(index=True)


class InstanceRow(Base):
    """This installation: an identifier that names its cookie, so that two on one host do not share one."""

    __tablename__ = "instance"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    instance: Mapped[str] = mapped_column(String(32))
    created_ms: Mapped[int]
    bus_key: Mapped[str | None] = mapped_column(String(64))
    """With which backends of this database seal what they say to one another (`replicas.sealed`), hexadecimal."""
