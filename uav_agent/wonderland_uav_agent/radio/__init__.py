"""The drone's UWB node on its serial port: one that speaks UCI, or a DWM1001 tag (``tag``)."""

from wonderland_uav_agent.radio.node import UavRadio

__all__ = ["UavRadio"]
