"""Where the lab's attacks happen: pads as a good commissioning leaves them, and places about them.

All lengths are millimetres in the pad's frame. The frame is artificial: one unit of latitude or longitude is one
millimetre, so that a claim is not rounded and thousands of tries can be moved about as arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wonderland.proofs.records.calibrations import SIGMA_FLOOR_MM
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame
from wonderland.proofs.records.policies import Policy

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

START_MS: Final = 1_800_000_000_000
"""The request's time in every try."""
FIRST_ROUND_MS: Final = 500
ROUND_MS: Final = 50
ROUNDS: Final = 160
"""As many as a pad ranges at most."""
SURVEY_SIGMA_MM: Final = 3
BIAS_SIGMA_MM: Final = 6
INSTALLATION_SIGMA_MM: Final = 8
RANGE_SIGMA_MM: Final = 30
OFFSET_SIGMA_MM: Final = SIGMA_FLOOR_MM
"""How well a calibration knows what a drone's node adds."""
FRAME: Final = Frame(lat_e7=0, lon_e7=0, height_mm=0, e1=1 << 32, e2=0, e3=0, n1=1 << 32, n2=0, n3=0, n4=0, u2=0, u3=0)


@dataclass(frozen=True)
class LabPad:
    """A pad of the lab. ``anchors``: one row (east, north, up) each.

    Drones hover ``near`` to ``far`` from its middle, ``low`` to ``high`` above it.
    """

    name: str
    title: str
    anchors: Floats
    near: float = 4_000.0
    far: float = 14_000.0
    low: float = 4_000.0
    high: float = 7_000.0
    range_sigma: int = RANGE_SIGMA_MM
    bearing: float = np.pi
    """Drones hover within this angle (rad) of east."""
    bias_sigma: int = BIAS_SIGMA_MM
    bias_length: int | None = None
    bias_fixed: int | None = None
    """How biases change over place, as ``Commissioning`` has it (mm, ppm); None: they are the same everywhere."""

    @property
    def commissioning(self) -> Commissioning:
        """What the contract knows of it."""
        return Commissioning(
            frame=FRAME,
            anchors=tuple(
                Anchor(
                    anchor_id=f"A{index + 1}",
                    mac=index + 1,
                    east_mm=round(east),
                    north_mm=round(north),
                    up_mm=round(up),
                    survey_sigma_mm=SURVEY_SIGMA_MM,
                    bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=self.bias_sigma),),
                )
                for index, (east, north, up) in enumerate(self.anchors)
            ),
            range_sigma_mm=self.range_sigma,
            installation_sigma_mm=INSTALLATION_SIGMA_MM,
            max_range_mm=100_000,
            valid_from_ms=0,
            valid_until_ms=START_MS * 2,
            method="The attack lab: as after a good commissioning",
            bias_length_mm=self.bias_length,
            bias_fixed_ppm=self.bias_fixed,
        )

    def places(self, rng: np.random.Generator, count: int) -> Floats:
        """Places to hover about the pad, uniform in distance, bearing and height: (count, 3)."""
        bearing = rng.uniform(-self.bearing, self.bearing, count)
        away = rng.uniform(self.near, self.far, count)
        up = rng.uniform(self.low, self.high, count)
        return np.column_stack((away * np.cos(bearing), away * np.sin(bearing), up))


def ring(count: int, radius: float) -> Floats:
    """Anchors on a circle, the first one raised."""
    angles = np.pi / count + 2.0 * np.pi * np.arange(count) / count
    up = np.where(np.arange(count) == 0, 1_600.0, 250.0)
    return np.column_stack((radius * np.cos(angles), radius * np.sin(angles), up))


def flat(anchors: Floats) -> Floats:
    """The same anchors, none raised."""
    return np.column_stack((anchors[:, 0], anchors[:, 1], np.full(len(anchors), 250.0)))


SQUARE: Final = LabPad("square", "four anchors, 3.2 m square, one raised; drones 4 to 14 m away", ring(4, 2_263.0))
FLAT: Final = LabPad("flat", "the same with no anchor raised", flat(ring(4, 2_263.0)))
FIVE: Final = LabPad("five", "five anchors on a circle of 2.3 m", ring(5, 2_263.0))
SIX: Final = LabPad("six", "six anchors on a circle of 2.3 m", ring(6, 2_263.0))
WIDE: Final = LabPad(
    "wide", "four anchors, 20 m square, drones between them", ring(4, 14_142.0), near=0.0, far=7_000.0, low=2_000.0
)
FLOWN: Final = LabPad(
    "flown",
    "the square with biases of 100 mm, a quarter of whose variance stays over place and the rest changes over 2 m",
    SQUARE.anchors,
    bias_sigma=100,
    bias_length=2_000,
    bias_fixed=250_000,
)
SMALL: Final = LabPad(
    "small",
    "the paper's pad, 0.34 by 0.56 m, drones 12 to 14 m away",
    np.array([(-171.0, -279.0, 0.0), (-171.0, 279.0, 0.0), (171.0, 279.0, 0.0), (171.0, -279.0, 0.0)]),
    near=12_000.0,
    far=14_000.0,
    low=0.0,
    high=1.0,
    range_sigma=50,
)
CUBE: Final = LabPad(
    "cube",
    "eight anchors at the corners of a cube of 6 m, drones in it and above it",
    np.array([(x, y, z) for z in (250.0, 6_250.0) for x in (-3_000.0, 3_000.0) for y in (-3_000.0, 3_000.0)]),
    near=0.0,
    far=4_000.0,
    low=500.0,
    high=8_000.0,
)
ROW: Final = LabPad(
    "row",
    "five anchors, three of them in a row: the corners of 6 by 4 m and, raised, the middle of one side",
    np.array(
        [
            (-3_000.0, -2_000.0, 250.0),
            (3_000.0, -2_000.0, 250.0),
            (0.0, -2_000.0, 1_600.0),
            (3_000.0, 2_000.0, 250.0),
            (-3_000.0, 2_000.0, 250.0),
        ]
    ),
)
MASTS: Final = LabPad(
    "masts",
    "six anchors on a circle of 4.3 m, every other one 3 m up",
    np.column_stack((ring(6, 4_250.0)[:, :2], np.array([250.0, 3_250.0] * 3))),
    near=0.0,
    far=8_000.0,
    low=500.0,
    high=8_000.0,
)
WITNESS_AT_MM: Final = (12_000.0, 0.0, 0.0)
"""Where the second pad's middle is, in the first one's frame."""
TIMED: Final = LabPad("timed", "six anchors on a circle of 4.3 m, as level 3 wants them", ring(6, 4_250.0))
BETWEEN: Final = LabPad(
    "between",
    "the same with a second one 12 m to the east; drones between them",
    ring(6, 4_250.0),
    near=4_000.0,
    far=8_000.0,
    bearing=0.5,
)


def witness_of(pad: LabPad) -> LabPad:
    """The second pad, of the same build, in the first one's frame."""
    return LabPad("witness", "the second pad", pad.anchors + np.array(WITNESS_AT_MM))


POLICY: Final = Policy()
"""Buffer 1 m, and all else as the records default; ``min_assurance`` is set for each level."""


def directions(rng: np.random.Generator, count: int) -> Floats:
    """Horizontal unit vectors: (count, 3)."""
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.column_stack((np.cos(angle), np.sin(angle), np.zeros(count)))


def distances(place: Floats, anchors: Floats) -> Floats:
    """Distances from places (…, 3) to each anchor (A, 3): (…, A)."""
    return np.asarray(np.linalg.norm(place[..., None, :] - anchors, axis=-1), dtype=np.float64)


def systematic(rng: np.random.Generator, count: int, anchors: int) -> Floats:
    """Errors of a commissioning that stay the same through a session: (count, 1, anchors)."""
    own = rng.normal(0.0, np.hypot(BIAS_SIGMA_MM, SURVEY_SIGMA_MM), (count, 1, anchors))
    return np.asarray(own + rng.normal(0.0, INSTALLATION_SIGMA_MM, (count, 1, 1)), dtype=np.float64)


def systematic_along(rng: np.random.Generator, pad: LabPad, truth: Floats) -> Floats:
    """The same of drones that fly straight on, or hover: (count, rounds, anchors) for places (count, rounds, 3).

    Each anchor's bias changes along the way, with correlation exp(−way/L), about a part that stays.
    """
    count, rounds = truth.shape[:2]
    anchors = len(pad.anchors)
    fixed = 1.0 if pad.bias_fixed is None else pad.bias_fixed / 1e6
    length = float(pad.bias_length or 1)
    stays = rng.normal(0.0, np.sqrt(fixed) * pad.bias_sigma, (count, 1, anchors))
    steps = np.linalg.norm(np.diff(truth, axis=1), axis=2)
    alike = np.exp(-steps / length)[:, :, None]
    changes = np.empty((count, rounds, anchors))
    changes[:, 0] = rng.normal(0.0, 1.0, (count, anchors))
    anew = rng.normal(0.0, 1.0, (count, rounds - 1, anchors)) * np.sqrt(1.0 - alike**2)
    for number in range(1, rounds):
        changes[:, number] = changes[:, number - 1] * alike[:, number - 1] + anew[:, number - 1]
    own = stays + np.sqrt(1.0 - fixed) * pad.bias_sigma * changes
    survey = rng.normal(0.0, SURVEY_SIGMA_MM, (count, 1, anchors))
    return np.asarray(own + survey + rng.normal(0.0, INSTALLATION_SIGMA_MM, (count, 1, 1)), dtype=np.float64)
