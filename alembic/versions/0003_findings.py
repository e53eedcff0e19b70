"""findings of the pads' receivers"""

import sqlalchemy as sa

from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:

    op.create_table(
        "findings",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("uav_id", sa.String(length=128), nullable=False),
        sa.Column("pad_id", sa.String(length=128), nullable=False),
        sa.Column("kind", sa.String(length=32), nullable=False),
        sa.Column("t_ms", sa.BigInteger(), nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_findings")),
    )
    with op.batch_alter_table("findings", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_findings_pad_id_t_ms"), ["pad_id", "t_ms"], unique=False)
        batch_op.create_index(batch_op.f("ix_findings_t_ms"), ["t_ms"], unique=False)
        batch_op.create_index(batch_op.f("ix_findings_uav_id_t_ms"), ["uav_id", "t_ms"], unique=False)


def downgrade() -> None:
    op.drop_table("findings")
