"""A virtual board on a pseudo-terminal, with four anchors whose distances a test can change."""

from __future__ import annotations

import random
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from wonderland_fira_uci.dwm1001 import AnchorDistance, BoardPosition, Generation
from wonderland_simulator.dwm1001_node import Quirks, VirtualAnchor, VirtualDwm1001
from wonderland_simulator.uci_node import Measurement, PtyPort

ANCHORS = tuple(
    VirtualAnchor(0xA001 + index, f"a{index}", BoardPosition(1_000 * index, 500, 2_250, 100)) for index in range(4)
)


@dataclass
class Bench:
    """Boards by name, and what they measure (mm, None: not heard)."""

    directory: Path
    distances: dict[str, int | None] = field(default_factory=lambda: {f"a{i}": 5_000 + 111 * i for i in range(4)})
    ports: dict[str, PtyPort] = field(default_factory=dict)
    boards: dict[str, VirtualDwm1001] = field(default_factory=dict)
    rng: random.Random = field(default_factory=lambda: random.Random(5))

    def measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        distance = self.distances.get(peer)
        return Measurement(None if distance is None else distance + self.rng.randrange(-40, 41))

    def add(self, name: str = "tag", generation: Generation = Generation.PANS_R2, quirks: Quirks | None = None) -> Path:
        board = VirtualDwm1001(
            name,
            ANCHORS,
            self.measure,
            rng=random.Random(3),
            generation=generation,
            quirks=quirks or Quirks(update_ms=20),
            solve=_middle,
        )
        self.boards[name] = board
        self.ports[name] = PtyPort(board, self.directory / name)
        self.ports[name].plug()
        return self.ports[name].path

    def close(self) -> None:
        for port in self.ports.values():
            port.close()


def _middle(distances: Sequence[AnchorDistance]) -> BoardPosition:
    return BoardPosition(sum(distance.range_mm or 0 for distance in distances), -20, 1_680, 97)


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


@pytest.fixture
def make_bench() -> Callable[[Path], Bench]:
    return Bench
