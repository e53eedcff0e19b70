"""A pad's nodes and a drone's on pseudo-terminals, joined by the simulator's air."""

from __future__ import annotations

import random
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from wonderland.uwb.layout import RangingPlan
from wonderland_simulator.uci_node import DWM3001CDK, Air, Measurement, NodeProfile, PtyPort, Quirks, VirtualNode

PAD_MACS = (0xA001, 0xA002, 0xA003, 0xA004)
UAV_MAC = 0xD001


@dataclass
class World:
    """Distances in millimetres by the pair's names; a test may change them while it runs."""

    directory: Path
    distances: dict[str, int | None] = field(default_factory=dict)
    ports: dict[str, PtyPort] = field(default_factory=dict)
    air: Air = field(init=False)

    def __post_init__(self) -> None:
        self.air = Air(self.measure, rng=random.Random(7))

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        anchor = observer if observer != "uav" else peer
        distance = self.distances.get(anchor, 5_000)
        return Measurement(distance, nlos=False, rssi_dbm=-78.5)

    def add(self, name: str, quirks: Quirks | None = None, *, profile: NodeProfile = DWM3001CDK) -> Path:
        node = VirtualNode(name, self.air, profile=profile, quirks=quirks)
        self.ports[name] = PtyPort(node, self.directory / name)
        self.ports[name].plug()
        return self.ports[name].path

    def close(self) -> None:
        for port in self.ports.values():
            port.close()
        self.air.close()


@pytest.fixture
async def world(tmp_path: Path) -> AsyncIterator[World]:
    made = World(tmp_path)
    yield made
    made.close()


@pytest.fixture
def plan() -> Callable[..., RangingPlan]:
    def make(**changes: object) -> RangingPlan:
        values: dict[str, object] = {
            "session_a_id": 0x1000_0001,
            "session_b_id": 0x1000_0002,
            "pad_macs": PAD_MACS,
            "uav_mac": UAV_MAC,
            "sts_key": bytes(range(16)),
        }
        return RangingPlan(**(values | changes))  # type: ignore[arg-type]

    return make
