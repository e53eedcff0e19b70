"""what drones broadcast of their operators, apart from their positions, which are shown to more people"""

import sqlalchemy as sa

from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "broadcast_operators",
        sa.Column("uav_id", sa.String(128), nullable=False),
        sa.Column("operator_id", sa.String(128), nullable=False),
        sa.Column("pad_id", sa.String(128), nullable=False),
        sa.Column("t_ms", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("uav_id", name=op.f("pk_broadcast_operators")),
    )
    op.create_index(op.f("ix_broadcast_operators_t_ms"), "broadcast_operators", ["t_ms"])
    sqlite = op.get_bind().dialect.name == "sqlite"
    without = "json_remove(body, '$.operator_id')" if sqlite else "(body::jsonb - 'operator_id')::text"
    for table in ("tracks", "latest_tracks"):
        op.execute(f"UPDATE {table} SET body = {without} WHERE body LIKE '%\"operator_id\"%'")  # noqa: S608 - our own names


def downgrade() -> None:
    op.drop_table("broadcast_operators")
