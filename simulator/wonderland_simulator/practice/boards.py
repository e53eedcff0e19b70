"""Virtual boards of any kind, for pads and for what flies."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Final

from wonderland_fira_uci.dwm1001 import BoardPosition
from wonderland_simulator.dwm1001_node import VirtualAnchor, VirtualDwm1001
from wonderland_simulator.pads_air import PadsAir
from wonderland_simulator.scenario import DWM1001
from wonderland_simulator.uci_node import VirtualNode
from wonderland_simulator.uci_node.profiles import PROFILES
from wonderland_simulator.uci_node.pty import PortDevice

DRONE_ADDRESS: Final = 0x1A2B
_PAD_ADDRESS: Final = 0x2000


class Boards:
    """``flying``: what flies with a DWM1001, which the pads' tags measure: short addresses by name."""

    def __init__(self, air: PadsAir, flying: Mapping[str, int]) -> None:
        self._air = air
        self._flying = flying
        self._made = 0

    def make(self, kind: str, name: str) -> PortDevice:
        """A board as out of the box: a DWM1001 has no network and no role yet."""
        if kind != DWM1001:
            return VirtualNode(name, self._air.air, profile=PROFILES[kind])
        flies = name in self._flying
        anchors = [VirtualAnchor(address, each, BoardPosition(0, 0, 0)) for each, address in self._flying.items()]
        board = VirtualDwm1001(
            name,
            [] if flies else anchors,
            self._air.measure,
            rng=random.Random(f"{name}/board"),
            address=self._flying.get(name, _PAD_ADDRESS + self._made),
        )
        self._made += 1
        board.mode = "an"
        return board
