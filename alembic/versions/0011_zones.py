"""zones, and the closures of pads"""

import sqlalchemy as sa

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "closures",
        sa.Column("pad_id", sa.String(128), nullable=False),
        sa.Column("valid_until_ms", sa.BigInteger(), nullable=False),
        sa.Column("record", sa.Text(), nullable=False),
        sa.Column("block", sa.BigInteger(), nullable=False),
        sa.Column("tx_index", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("pad_id", name=op.f("pk_closures")),
    )
    op.create_table(
        "zone_sets",
        sa.Column("import_id", sa.String(32), nullable=False),
        sa.Column("source", sa.String(64), nullable=False),
        sa.Column("current", sa.String(64), nullable=True),
        sa.Column("format", sa.String(16), nullable=False),
        sa.Column("file_sha256", sa.String(64), nullable=False),
        sa.Column("size_bytes", sa.BigInteger(), nullable=False),
        sa.Column("zones", sa.BigInteger(), nullable=False),
        sa.Column("notices", sa.Text(), nullable=False),
        sa.Column("about", sa.Text(), nullable=False),
        sa.Column("imported_ms", sa.BigInteger(), nullable=False),
        sa.Column("imported_by", sa.String(128), nullable=False),
        sa.Column("replaced_ms", sa.BigInteger(), nullable=True),
        sa.PrimaryKeyConstraint("import_id", name=op.f("pk_zone_sets")),
    )
    op.create_index(op.f("ix_zone_sets_source_imported_ms"), "zone_sets", ["source", "imported_ms"])
    op.create_index(op.f("ix_zone_sets_imported_ms_import_id"), "zone_sets", ["imported_ms", "import_id"])
    op.create_index("uq_zone_sets_current", "zone_sets", ["current"], unique=True)
    op.create_table(
        "zones",
        sa.Column("import_id", sa.String(32), nullable=False),
        sa.Column("zone_id", sa.String(16), nullable=False),
        sa.Column("type", sa.String(24), nullable=False),
        sa.Column("country", sa.String(3), nullable=False),
        sa.Column("west", sa.BigInteger(), nullable=False),
        sa.Column("south", sa.BigInteger(), nullable=False),
        sa.Column("east", sa.BigInteger(), nullable=False),
        sa.Column("north", sa.BigInteger(), nullable=False),
        sa.Column("feature", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("import_id", "zone_id", name=op.f("pk_zones")),
    )
    op.create_index(op.f("ix_zones_zone_id"), "zones", ["zone_id"])
    op.create_index(op.f("ix_zones_south_north"), "zones", ["south", "north"])


def downgrade() -> None:
    op.drop_table("zones")
    op.drop_table("zone_sets")
    op.drop_table("closures")
