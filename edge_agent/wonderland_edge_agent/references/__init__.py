"""Where the drone truly is, from whatever knows it: a motion capture, a topic of ROS 2, datagrams.

For commissioning a pad, and beside its estimates. Nothing that the contract judges comes from here.
"""

from __future__ import annotations

from wonderland_edge_agent.references.errors import PositionError, SourceError

Point = tuple[float, float, float]
"""East, north, up in the survey's frame (m)."""

__all__ = ["Point", "PositionError", "SourceError"]
