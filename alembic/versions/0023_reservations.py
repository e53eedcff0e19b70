"""reservations: for whom a pad is kept, and when"""

import sqlalchemy as sa

from alembic import op

revision = "0023"
down_revision = "0022"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "reservations",
        sa.Column("pad_id", sa.String(128), nullable=False),
        sa.Column("record", sa.Text(), nullable=False),
        sa.Column("block", sa.BigInteger(), nullable=False),
        sa.Column("tx_index", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("pad_id", name=op.f("pk_reservations")),
    )


def downgrade() -> None:
    op.drop_table("reservations")
