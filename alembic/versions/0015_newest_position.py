"""tracks: the newest position of a drone by its index alone, however many there are within a minute"""

from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index("ix_tracks_uav_id_t_ms_received_ms_id", "tracks", ["uav_id", "t_ms", "received_ms", "id"])
    op.drop_index("ix_tracks_uav_id_t_ms_received_ms", table_name="tracks")


def downgrade() -> None:
    op.create_index("ix_tracks_uav_id_t_ms_received_ms", "tracks", ["uav_id", "t_ms", "received_ms"])
    op.drop_index("ix_tracks_uav_id_t_ms_received_ms_id", table_name="tracks")
