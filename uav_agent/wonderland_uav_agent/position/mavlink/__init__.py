"""Positions from an autopilot (PX4, ArduPilot) by MAVLink: a pure core, and a thin shell around links.

``navigator`` takes messages and returns claims or why there is none; ``rates`` is its part,
``wire`` knows pymavlink, ``source`` knows sockets and lines.
"""

from wonderland_uav_agent.position.mavlink.address import Address, SerialAddress, TcpAddress, UdpAddress, parse_address
from wonderland_uav_agent.position.mavlink.source import MavlinkPosition

__all__ = ["Address", "MavlinkPosition", "SerialAddress", "TcpAddress", "UdpAddress", "parse_address"]
