"""The paper's four points (its figures 4 and 5), and what came of one that was sent the whole way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland_simulator.verdicts import CommittedVerdict

SIGMA_M: Final = 0.05
SHORT_ANCHORS: Final = ((2.5, 0.6), (2.5, 1.15), (2.85, 1.15), (2.85, 0.6))
LONG_ANCHORS: Final = ((1.26, 0.518), (1.26, -0.0393), (0.918, -0.0393), (0.918, 0.518))


@dataclass(frozen=True)
class PaperPoint:
    """One of the paper's four measurements: where the drone was, and the error circle that the paper drew."""

    name: str
    anchors: tuple[tuple[float, float], ...]
    position: tuple[float, float]
    paper_error_m: float


POINTS: Final = (
    PaperPoint("S1", SHORT_ANCHORS, (3.95, 2.705), 0.09),
    PaperPoint("S2", SHORT_ANCHORS, (3.126, 3.035), 0.045),
    PaperPoint("L1", LONG_ANCHORS, (4.2, 12.745), 0.25),
    PaperPoint("L2", LONG_ANCHORS, (4.931, 13.982), 0.16),
)


def cramer_rao_m(point: PaperPoint, rounds: int, sigma_m: float = SIGMA_M) -> float:
    """Least root-mean-square error that any unbiased estimate of the position can have."""
    here = np.array(point.position)
    directions = here - np.array(point.anchors)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    information = rounds / sigma_m**2 * directions.T @ directions
    return float(math.sqrt(np.trace(np.linalg.inv(information))))


@dataclass(frozen=True)
class PaperRun:
    """One point, sent the whole way: its committed verdict, and when its drone was permitted to land (ms)."""

    point: PaperPoint
    item: CommittedVerdict
    permitted_ms: int | None

    @property
    def steps_ms(self) -> dict[str, int]:
        """Milliseconds from the request to the end of each step."""
        times = {step.step: step.t_ms for step in self.item.evidence.steps}
        times["verdict"] = self.item.seen_ms
        if self.permitted_ms is not None:  # the drone may read the committed event before this reader of blocks does
            times["permission"] = self.permitted_ms
            times["verdict"] = min(times["verdict"], self.permitted_ms)
        start = times.get("request", min(times.values()))
        return {name: max(0, times[name] - start) for name in STEP_NAMES if name in times}

    def line(self) -> dict[str, Any]:
        """One JSON object for machines."""
        return {
            "point": self.point.name,
            "paper_error_m": self.point.paper_error_m,
            "cramer_rao_m": round(cramer_rao_m(self.point, self.item.verdict.rounds), 4),
            "cramer_rao_one_round_m": round(cramer_rao_m(self.point, 1), 4),
            "since_request_ms": self.steps_ms,
            **self.item.line(),
        }
