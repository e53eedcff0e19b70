"""A virtual DWM1001: the board's side of both its serial modes, on a pseudo-terminal that an agent cannot tell.

board = VirtualDwm1001("uav-1", anchors, measure, rng=random.Random(1))
port = PtyPort(board, directory / "tag")
port.plug()
"""

from wonderland_simulator.dwm1001_node.node import Quirks, VirtualAnchor, VirtualDwm1001

__all__ = ["Quirks", "VirtualAnchor", "VirtualDwm1001"]
