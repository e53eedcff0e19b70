"""The pad's UWB nodes: one serial port each, opened together for a session and read as one stream of reports."""

from edge_agent.radios.nodes import AnchorPort, AnchorState, PadRadios, RadiosError

__all__ = ["AnchorPort", "AnchorState", "PadRadios", "RadiosError"]
