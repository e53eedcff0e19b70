"""Turns by quaternions, which ROS and PX4 have alike but for the order of their numbers. Pure."""

from __future__ import annotations

from wonderland_uav_agent.position.mavlink.attitude import Vector

Quaternion = tuple[float, float, float, float]
"""x, y, z, w, of length 1."""


def turned(by: Quaternion, vector: Vector) -> Vector:
    """The vector, turned."""
    x, y, z, w = by
    a, b, c = vector
    # v + 2 u × (u × v + w v), u being the vector part.
    p, q, r = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    return a + 2 * (y * r - z * q), b + 2 * (z * p - x * r), c + 2 * (x * q - y * p)
