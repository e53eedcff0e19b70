"""requests for proofs"""

import sqlalchemy as sa

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "proof_requests",
        sa.Column("request_id", sa.String(32), nullable=False),
        sa.Column("uav_id", sa.String(128), nullable=False),
        sa.Column("pad_id", sa.String(128), nullable=False),
        sa.Column("action", sa.String(16), nullable=False),
        sa.Column("requested_by", sa.String(128), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("created_ms", sa.BigInteger(), nullable=False),
        sa.Column("expires_ms", sa.BigInteger(), nullable=False),
        sa.Column("told_ms", sa.BigInteger(), nullable=True),
        sa.Column("accepted", sa.Boolean(), nullable=True),
        sa.Column("answer", sa.Text(), nullable=True),
        sa.Column("cancelled_ms", sa.BigInteger(), nullable=True),
        sa.PrimaryKeyConstraint("request_id", name=op.f("pk_proof_requests")),
    )
    for columns in (["expires_ms"], ["uav_id", "created_ms"], ["created_ms", "request_id"]):
        op.create_index(op.f(f"ix_proof_requests_{'_'.join(columns)}"), "proof_requests", columns)


def downgrade() -> None:
    op.drop_table("proof_requests")
