"""The drone's UWB node on its serial port."""

from uav_agent.radio.node import UavRadio

__all__ = ["UavRadio"]
