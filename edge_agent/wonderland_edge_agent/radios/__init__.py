"""The pad's UWB nodes: one serial port each, opened together for a session and read as one stream of reports.

``reported`` stands in for them where the anchors are DWM1001 boards, whose ranges only the drone's tag knows.
"""

from wonderland_edge_agent.radios.anchors import AnchorPort, AnchorState, RadiosError
from wonderland_edge_agent.radios.nodes import PadRadios

__all__ = ["AnchorPort", "AnchorState", "PadRadios", "RadiosError"]
