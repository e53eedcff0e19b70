"""What the drone itself broadcasts over Remote ID, so that it can sign for it."""

from wonderland_uav_agent.broadcasts.module import RemoteIdModule
from wonderland_uav_agent.broadcasts.source import BroadcastError, BroadcastSource, NoBroadcasts

__all__ = ["BroadcastError", "BroadcastSource", "NoBroadcasts", "RemoteIdModule"]
