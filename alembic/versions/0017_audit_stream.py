"""audit_stream: up to which row the audit log was sent elsewhere"""

import sqlalchemy as sa

from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "audit_stream",
        sa.Column("destination", sa.String(length=256), nullable=False),
        sa.Column("seq", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("destination", name=op.f("pk_audit_stream")),
    )


def downgrade() -> None:
    op.drop_table("audit_stream")
