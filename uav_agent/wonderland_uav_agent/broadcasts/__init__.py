"""What the drone itself broadcasts over Remote ID: heard, to sign for it, and told to its autopilot."""

from wonderland_uav_agent.broadcasts.module import RemoteIdModule
from wonderland_uav_agent.broadcasts.settings import OpenDroneIdSettings
from wonderland_uav_agent.broadcasts.source import BroadcastError, BroadcastSource, NoBroadcasts

__all__ = ["BroadcastError", "BroadcastSource", "NoBroadcasts", "OpenDroneIdSettings", "RemoteIdModule"]
