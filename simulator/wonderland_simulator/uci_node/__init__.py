"""Virtual UWB nodes: they speak UCI on real pseudo-terminals and meet each other in an ``Air``.

air = Air(measure, rng=random.Random(1))
node = VirtualNode("pad-1/anchor-1", air)
port = PtyPort(node, directory / "anchor-1")     # a stable path, as /dev/serial/by-id would be
port.plug()
…                                                 # an agent opens the path; it cannot tell
port.unplug(); port.plug()
port.close()
"""

from wonderland_simulator.uci_node.air import Air, Measure, Measurement
from wonderland_simulator.uci_node.node import VirtualNode
from wonderland_simulator.uci_node.profiles import DWM3001CDK, IDEAL, PICA, QM35, SR150, NodeProfile, Quirks
from wonderland_simulator.uci_node.pty import PtyPort, plugged

__all__ = [
    "DWM3001CDK",
    "IDEAL",
    "PICA",
    "QM35",
    "SR150",
    "Air",
    "Measure",
    "Measurement",
    "NodeProfile",
    "PtyPort",
    "Quirks",
    "VirtualNode",
    "plugged",
]
