"""history: when what was known, every version of pads and drones, partitions by day on PostgreSQL

No row is lost. What was stored before is dated by its own time: when it was received nobody wrote down.
"""

# ruff: noqa: S608 - the names in these statements stand here, none comes from outside
import json
from datetime import UTC, datetime

import sqlalchemy as sa

from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

DAY_MS = 86_400_000
MOST_DAYS = 400
ROW_ID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
BIG = {  # name: (columns between id and t_ms, indexes beside that on received_ms, indexes of the table before)
    "tracks": (("uav_id", "pad_id"), ("uav_id", "t_ms", "received_ms"), (("t_ms",), ("uav_id", "t_ms"))),
    "estimates": (
        ("session_id", "uav_id", "pad_id"),
        ("session_id", "received_ms"),
        (("session_id", "t_ms"), ("t_ms",)),
    ),
}
VERSIONED = {  # kind: (parts of its key, events whose record it is)
    "pad": (("pad_id",), ("PadRegistered", "PadUpdated", "PadRetired", "PadCommissioned")),
    "uav": (("uav_id",), ("UavRegistered", "UavStatusSet", "MaintenanceRecorded")),
    "authorisation": (("uav_id", "authorisation_id"), ("AuthorisationGranted", "AuthorisationRevoked")),
    "policy": (("pad_id", "action"), ("PolicySet",)),
}


def upgrade() -> None:
    postgresql = op.get_bind().dialect.name == "postgresql"
    for table, (names, index, before) in BIG.items():
        for columns in before:
            op.drop_index(f"ix_{table}_{'_'.join(columns)}", table_name=table)
        if postgresql:
            _partition_anew(table, names)
        else:
            _date(table)
        _index(table, *index)
        _index(table, "received_ms")
    columns = [sa.Column("pad_id", sa.String(length=128), nullable=False), *_tail(received=True)]
    if postgresql:
        _create_partitioned("pad_health", columns)
    else:
        op.create_table(
            "pad_health",
            sa.Column("id", ROW_ID, nullable=False),
            *columns,
            sa.PrimaryKeyConstraint("id", name=op.f("pk_pad_health")),
        )
    _index("pad_health", "pad_id", "received_ms")
    _index("pad_health", "received_ms")
    _small_tables()
    _steps_and_ends()
    _alerts()
    _fill()


def _tail(*, received: bool) -> list[sa.Column]:
    columns = [sa.Column("t_ms", sa.BigInteger(), nullable=False)]
    if received:
        columns.append(sa.Column("received_ms", sa.BigInteger(), nullable=False))
    return [*columns, sa.Column("body", sa.Text(), nullable=False)]


def _index(table: str, *columns: str) -> None:
    op.create_index(f"ix_{table}_{'_'.join(columns)}", table, list(columns))


def _text(name: str) -> sa.Column:
    return sa.Column(name, sa.String(length=64 if name == "session_id" else 128), nullable=False)


def _create_partitioned(table: str, columns: list[sa.Column]) -> None:
    op.execute(f"CREATE SEQUENCE {table}_ids")
    op.create_table(
        table,
        sa.Column("id", sa.BigInteger(), nullable=False, server_default=sa.text(f"nextval('{table}_ids')")),
        *columns,
        postgresql_partition_by="RANGE (received_ms)",
    )
    op.execute(f"ALTER SEQUENCE {table}_ids OWNED BY {table}.id")
    op.execute(f"CREATE TABLE {table}_default PARTITION OF {table} DEFAULT")


def _partition_anew(table: str, names: tuple[str, ...]) -> None:
    op.rename_table(table, f"old_{table}")
    _create_partitioned(table, [*map(_text, names), *_tail(received=True)])
    days = op.get_bind().execute(sa.text(f"SELECT DISTINCT t_ms / {DAY_MS} FROM old_{table} LIMIT {MOST_DAYS}"))
    for day in sorted(row[0] for row in days):
        if day >= 0:
            name = f"{table}_{datetime.fromtimestamp(day * DAY_MS / 1000, UTC):%Y%m%d}"
            limits = f"FROM ({day * DAY_MS}) TO ({(day + 1) * DAY_MS})"
            op.execute(f'CREATE TABLE "{name}" PARTITION OF {table} FOR VALUES {limits}')
    columns = ", ".join(("id", *names, "t_ms", "body"))
    op.execute(f"INSERT INTO {table} ({columns}, received_ms) SELECT {columns}, t_ms FROM old_{table} ORDER BY id")
    op.execute(f"SELECT setval('{table}_ids', coalesce((SELECT max(id) FROM {table}), 0) + 1, false)")
    op.drop_table(f"old_{table}")


def _date(table: str) -> None:
    op.add_column(table, sa.Column("received_ms", sa.BigInteger(), nullable=True))
    op.execute(f"UPDATE {table} SET received_ms = t_ms")
    with op.batch_alter_table(table) as batch_op:
        batch_op.alter_column("received_ms", existing_type=sa.BigInteger(), nullable=False)


def _small_tables() -> None:
    op.create_table(
        "track_minutes",
        sa.Column("minute_ms", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("positions", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("minute_ms", name=op.f("pk_track_minutes")),
    )
    op.create_table(
        "pad_connections",
        sa.Column("pad_id", sa.String(length=128), nullable=False),
        sa.Column("server", sa.String(length=32), nullable=False),
        sa.Column("from_ms", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("until_ms", sa.BigInteger(), nullable=False),
        sa.Column("ended", sa.Boolean(), nullable=False),
        sa.PrimaryKeyConstraint("pad_id", "server", "from_ms", name=op.f("pk_pad_connections")),
    )
    _index("pad_connections", "from_ms")
    _index("pad_connections", "until_ms")
    op.create_table(
        "block_arrivals",
        sa.Column("number", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("known_ms", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_block_arrivals")),
    )
    _index("block_arrivals", "known_ms")
    op.create_table(
        "record_versions",
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("key", sa.String(length=128), nullable=False),
        sa.Column("block", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("tx_index", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("record", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("kind", "key", "block", "tx_index", name=op.f("pk_record_versions")),
    )
    _index("record_versions", "kind", "block")


def _steps_and_ends() -> None:
    op.add_column("reported_ends", sa.Column("received_ms", sa.BigInteger(), nullable=True))
    op.execute("UPDATE reported_ends SET received_ms = t_ms")
    with op.batch_alter_table("reported_ends") as batch_op:
        batch_op.alter_column("received_ms", existing_type=sa.BigInteger(), nullable=False)
    op.rename_table("reported_steps", "old_steps")
    if op.get_bind().dialect.name == "postgresql":
        op.execute("ALTER TABLE old_steps RENAME CONSTRAINT pk_reported_steps TO pk_old_steps")
    _create_steps(received=True)
    columns = "session_id, step, agent, agent_id, uav_id, t_ms, ok, detail"
    op.execute(f"INSERT INTO reported_steps ({columns}, received_ms) SELECT {columns}, t_ms FROM old_steps")
    op.drop_table("old_steps")
    _index("reported_steps", "received_ms")


def _create_steps(*, received: bool) -> None:
    key = ["session_id", "step", "agent", "agent_id"]
    dated = [sa.Column("received_ms", sa.BigInteger(), autoincrement=False, nullable=False)] if received else []
    op.create_table(
        "reported_steps",
        sa.Column("session_id", sa.String(length=64), nullable=False),
        sa.Column("step", sa.String(length=16), nullable=False),
        sa.Column("agent", sa.String(length=8), nullable=False),
        sa.Column("agent_id", sa.String(length=128), nullable=False),
        *dated,
        sa.Column("uav_id", sa.String(length=128), nullable=False),
        sa.Column("t_ms", sa.BigInteger(), nullable=False),
        sa.Column("ok", sa.Boolean(), nullable=False),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint(*key, *(column.name for column in dated), name=op.f("pk_reported_steps")),
    )


def _alerts() -> None:
    op.add_column("alerts", sa.Column("raised_ms", sa.BigInteger(), nullable=True))
    op.execute("UPDATE alerts SET raised_ms = CASE WHEN revision = 0 THEN changed_ms ELSE t_ms END")
    with op.batch_alter_table("alerts") as batch_op:
        batch_op.alter_column("raised_ms", existing_type=sa.BigInteger(), nullable=False)
    _index("alerts", "raised_ms")


def _fill() -> None:
    """What follows from rows that are there: each block was known about when it was made."""
    bind = op.get_bind()
    op.execute("INSERT INTO block_arrivals (number, known_ms) SELECT number, t_ms FROM blocks")
    op.execute(
        "INSERT INTO track_minutes (minute_ms, positions) SELECT received_ms - received_ms % 60000, count(*) "
        "FROM tracks WHERE received_ms >= 0 GROUP BY received_ms - received_ms % 60000"
    )
    for kind, (parts, names) in VERSIONED.items():
        events = sa.text("SELECT block, tx_index, payload FROM events WHERE name IN :names").bindparams(
            sa.bindparam("names", names, expanding=True)
        )
        for block, tx_index, payload in bind.execute(events).all():
            record = json.loads(payload).get("record") if payload.startswith("{") else None
            if not isinstance(record, dict) or not all(isinstance(record.get(part), str) for part in parts):
                continue
            row = {
                "kind": kind,
                "key": "/".join(record[part] for part in parts),
                "block": block,
                "tx_index": tx_index,
                # Canonical JSON of a record is sorted, close and not escaped.
                "record": json.dumps(
                    record.get(kind, record), sort_keys=True, separators=(",", ":"), ensure_ascii=False
                ),
            }
            bind.execute(sa.text("INSERT INTO record_versions VALUES (:kind, :key, :block, :tx_index, :record)"), row)


def downgrade() -> None:
    for table in ("record_versions", "block_arrivals", "pad_connections", "track_minutes", "pad_health"):
        op.drop_table(table)
    op.drop_index("ix_alerts_raised_ms", table_name="alerts")
    with op.batch_alter_table("alerts") as batch_op:
        batch_op.drop_column("raised_ms")
    op.drop_table("reported_steps")
    _create_steps(received=False)
    with op.batch_alter_table("reported_ends") as batch_op:
        batch_op.drop_column("received_ms")
    for table, (names, _, before) in BIG.items():
        op.drop_table(table)
        op.create_table(
            table,
            sa.Column("id", ROW_ID, nullable=False),
            *map(_text, names),
            *_tail(received=False),
            sa.PrimaryKeyConstraint("id", name=op.f(f"pk_{table}")),
        )
        for columns in before:
            _index(table, *columns)
