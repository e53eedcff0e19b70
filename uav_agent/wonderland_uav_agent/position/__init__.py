"""Where a drone's claims come from: an autopilot's datagrams, or a recorded track."""

from wonderland_uav_agent.position.autopilot import AutopilotPosition
from wonderland_uav_agent.position.source import PositionError, PositionSource, TellingPosition
from wonderland_uav_agent.position.track import TrackPosition

__all__ = ["AutopilotPosition", "PositionError", "PositionSource", "TellingPosition", "TrackPosition"]
