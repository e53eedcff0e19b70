"""registration_numbers: operators' numbers, which the ledger has as commitments only"""

import sqlalchemy as sa

from alembic import op

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "registration_numbers",
        sa.Column("commitment", sa.String(64), nullable=False),
        sa.Column("uav_id", sa.String(40), nullable=False),
        sa.Column("number", sa.String(32), nullable=False),
        sa.Column("salt", sa.String(64), nullable=False),
        sa.Column("stored_ms", sa.BigInteger(), nullable=False),
        sa.Column("stored_by", sa.String(128), nullable=False),
        sa.Column("tx_id", sa.String(64), nullable=True),
        sa.PrimaryKeyConstraint("commitment", name=op.f("pk_registration_numbers")),
    )
    for column in ("uav_id", "tx_id"):
        op.create_index(op.f(f"ix_registration_numbers_{column}"), "registration_numbers", [column])


def downgrade() -> None:
    op.drop_table("registration_numbers")
