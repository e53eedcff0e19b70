"""Where a drone's claims come from: an autopilot's datagrams, or a recorded track."""

from uav_agent.position.source import PositionError, PositionSource

__all__ = ["PositionError", "PositionSource"]
