"""Where the drone truly is, from whatever knows it: a motion capture, a topic of ROS 2, datagrams.

For commissioning a pad, and beside its estimates. Nothing that the contract judges comes from here.
"""

from __future__ import annotations

from wonderland_edge_agent.references.errors import PositionError, SourceError

Point = tuple[float, float, float]
"""East, north, up in the survey's frame (m)."""

LARGEST_M = 10_000.0
"""Nothing that a pad can see is further from it."""
STAMPED_S = 10.0
"""A time further from this computer's clock than this is another clock's, or a lie; the arrival counts then."""

__all__ = ["LARGEST_M", "STAMPED_S", "Point", "PositionError", "SourceError"]
