"""Drones whose node has an antenna delay of its own, calibrated truly, not at all, or falsely."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records.calibrations import MAX_OFFSET_MM
from wonderland_research.attack_lab.attacks.common import (
    BUFFER_MM,
    PAD_MEASURES,
    at_levels,
    pad_at,
    radially,
    still,
)
from wonderland_research.attack_lab.attacks.height import PADS, lie
from wonderland_research.attack_lab.batch import Batch
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import OFFSET_SIGMA_MM, SQUARE, WIDE, LabPad

DELAY_MM: Final = 300.0
"""As nodes have it whose antenna delay nobody set."""
GNSS_SIGMA_MM: Final = 150.0
LEAST_LIE: Final = BUFFER_MM
MOST_LIE: Final = 3.0 * BUFFER_MM


def false_offset(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Registered is the largest offset there may be, of the sign that moves the drone towards its claim."""
    pad = pad_at(level)
    near, far = radially(rng, count, near=LEAST_LIE, far=MOST_LIE, pad=pad)
    swap = rng.random(count) < 0.5
    claim = np.where(swap[:, None], np.rint(far), near)
    truth = np.where(swap[:, None], near, far)
    beyond = np.linalg.norm(claim[:, :2], axis=1) > np.linalg.norm(truth[:, :2], axis=1)
    batch = still(rng, level, np.rint(claim), truth, pad=pad)
    # Ranges are shortened by the offset: a claim farther out wants them longer.
    batch.offset_mm = np.where(beyond, -MAX_OFFSET_MM, MAX_OFFSET_MM)
    return batch


def false_height(rng: np.random.Generator, count: int) -> Batch:
    """A lie about the height, and as false an offset, at pads that tell much of heights, and little."""
    batch = lie(2, PADS[int(rng.integers(len(PADS)))], rng, count)
    batch.offset_mm = rng.choice((-MAX_OFFSET_MM, MAX_OFFSET_MM), count)
    return batch


def honest(calibrated: bool, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """An honest drone whose node ranges 0.3 m too long; calibrated as well as a calibration says that it is."""
    truth = pad.places(rng, count)
    claim = truth + rng.normal(0.0, GNSS_SIGMA_MM, truth.shape) * np.array((1.0, 1.0, 0.0))
    batch = still(rng, 2, np.rint(claim), truth, pad=pad, extra=np.full((count, 1, 1), DELAY_MM))
    batch.rightful = True
    if calibrated:
        batch.offset_mm = np.rint(rng.normal(DELAY_MM, OFFSET_SIGMA_MM, count)).astype(np.int64)
    return batch


_HONEST: Final = Attack(
    "honest-uncalibrated",
    Family.BASELINE,
    "No attack: the drone's node ranges 0.3 m too long, and nobody calibrated it; drones between the anchors",
    "Nothing.",
    "–",
    "Nothing: a permission is right. Counted here are honest drones that are refuted.",
    "–",
    0,
    (Variant(PAD_MEASURES, make=partial(honest, False, WIDE)),),
)

ATTACKS: Final = (
    _HONEST,
    replace(
        _HONEST,
        name="honest-calibrated",
        title="No attack: the same drone, calibrated at the pad",
        variants=(Variant(PAD_MEASURES, make=partial(honest, True, WIDE)),),
    ),
    replace(
        _HONEST,
        name="honest-uncalibrated-outside",
        title="No attack: the uncalibrated drone 4 to 14 m from the square",
        variants=(Variant(PAD_MEASURES, make=partial(honest, False, SQUARE)),),
    ),
    replace(
        _HONEST,
        name="honest-calibrated-outside",
        title="No attack: the calibrated drone 4 to 14 m from the square",
        variants=(Variant(PAD_MEASURES, make=partial(honest, True, SQUARE)),),
    ),
    Attack(
        "false-calibration",
        Family.COLLUSION,
        "A false calibration: 0.5 m, the most there may be, towards a claim 1 to 3 m off on the drone's bearing",
        "Whoever registers it: a pad's operator with the drone's; or a cable that the drone has only while it is "
        "calibrated.",
        "A signature of the pad's operator, or a metre of cable.",
        "A permission more than one buffer from the claim.",
        "Ranges are judged corrected *and* as they were measured, and both have to say verified: a calibration "
        "explains contradictions and moves no place.",
        0,
        at_levels(false_offset, *PAD_MEASURES),
        tolerated=0.01,
    ),
    Attack(
        "false-calibration-height",
        Family.COLLUSION,
        "The same false offset and a height that is false by 1 to 6 m, where a proven one is demanded",
        "As before.",
        "As before.",
        "A permission that demands a proven height, with one more than a buffer off.",
        "A height is proved where ranges prove it as they were measured, or bear the offset out themselves: they fit "
        "no place in space without it, and one with it.",
        0,
        (Variant(PAD_MEASURES, make=false_height),),
        tolerated=0.01,
    ),
)
