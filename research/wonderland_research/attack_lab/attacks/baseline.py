"""No attack: what honest drones get of the same pads, so that safety is not bought by refusing everybody."""

from __future__ import annotations

from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import at_levels, pad_at, still
from wonderland_research.attack_lab.batch import Batch
from wonderland_research.attack_lab.model import Attack, Family

GNSS_SIGMA_MM: Final = 150.0


def honest(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Claims are wrong by what a good receiver errs (15 cm on each axis)."""
    pad = pad_at(level)
    truth = pad.places(rng, count)
    claim = truth + rng.normal(0.0, GNSS_SIGMA_MM, truth.shape) * np.array((1.0, 1.0, 0.0))
    batch = still(rng, level, np.rint(claim), truth, pad=pad)
    batch.rightful = True
    return batch


ATTACKS: Final = (
    Attack(
        "honest",
        Family.BASELINE,
        "No attack: an honest drone",
        "Nothing.",
        "–",
        "Nothing: a permission is right. Counted here are honest drones that are refuted.",
        "–",
        0,
        at_levels(honest, 0, 1, 2),
        wire="honest",
    ),
)
