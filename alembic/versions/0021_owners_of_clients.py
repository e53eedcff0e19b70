"""owners_of_clients: whose machine it is, so that it can never do more than its person"""

import sqlalchemy as sa

from alembic import op

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("clients", sa.Column("owner_id", sa.String(32), nullable=False, server_default=""))


def downgrade() -> None:
    op.drop_column("clients", "owner_id")
