"""flights: which broadcast positions belong together"""

import sqlalchemy as sa

from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    numbers = (
        "start_ms", "end_ms", "positions", "south_e7", "west_e7", "north_e7", "east_e7",
        "first_lat_e7", "first_lon_e7", "last_lat_e7", "last_lon_e7",
    )  # fmt: skip
    op.create_table(
        "flights",
        sa.Column("flight_id", sa.String(32), nullable=False),
        sa.Column("uav_id", sa.String(128), nullable=False),
        *(sa.Column(name, sa.BigInteger(), nullable=False) for name in numbers),
        sa.PrimaryKeyConstraint("flight_id", name=op.f("pk_flights")),
    )
    for columns in (["uav_id", "end_ms"], ["start_ms", "flight_id"], ["end_ms"]):
        op.create_index(op.f(f"ix_flights_{'_'.join(columns)}"), "flights", columns)


def downgrade() -> None:
    op.drop_table("flights")
