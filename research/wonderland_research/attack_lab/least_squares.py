"""The decision's least squares for thousands of tries at once: part of the screen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from wonderland.proofs.estimate import LINE_STEPS, LINES
from wonderland_research.attack_lab.places import Booleans, Floats, Integers

_ITERATIONS: Final = 12


@dataclass(frozen=True)
class Solution:
    """(B, 2) offsets, their χ², and the length of the last step (mm)."""

    offset: Floats
    chi2: Floats
    moved: Floats


@dataclass(frozen=True)
class Problem:
    """The least-squares problem of B tries with A anchors."""

    anchors: Floats
    middle: Floats
    virtual: Floats
    own: Floats
    installation: float
    height: float

    def solve(self, start: Floats) -> Solution:
        """By Gauss–Newton; only the tries that still move go on."""
        offset = start.copy()
        chi2 = np.empty(len(start))
        moved = np.full(len(start), np.inf)
        going = np.arange(len(start))
        for iteration in range(_ITERATIONS):
            part = self.of(going)
            weights = part._weights(offset[going])  # noqa: SLF001 - its own
            unit, residual = part._directions(offset[going])  # noqa: SLF001
            turned = weights @ unit
            normal = np.swapaxes(unit, 1, 2) @ turned
            right = (np.swapaxes(turned, 1, 2) @ residual[:, :, None])[:, :, 0]
            chi2[going] = (residual[:, None, :] @ weights @ residual[:, :, None])[:, 0, 0]
            step = _solve2(normal, right)
            moved[going] = length = np.linalg.norm(step, axis=1)
            offset[going] += step * np.minimum(1.0, 20_000.0 / np.maximum(length, 1e-9))[:, None]
            going = going[~(length < 0.01) | (iteration == 0)]
            if not len(going):
                break
        return Solution(offset, chi2, moved)

    def of(self, rows: Integers) -> Problem:
        """The same problem for these rows (tries) alone."""
        return replace(self, middle=self.middle[rows], virtual=self.virtual[rows], own=self.own[rows])

    def mirrored(self, offset: Floats) -> Floats:
        """The offset mirrored at the line through the anchors."""
        middle = self.anchors[:, :2].mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((self.anchors[:, :2] - middle).T))
        line = vectors[:, 1]
        x = self.middle[:, :2] + offset - middle
        across = x[:, 1] * line[0] - x[:, 0] * line[1]
        return np.asarray(offset + 2.0 * across[:, None] * np.array((line[1], -line[0])), dtype=np.float64)

    def covariance(self, offset: Floats) -> tuple[Floats, Booleans]:
        """Inverse normal matrix, and where it has none worth the name."""
        unit, _ = self._directions(offset)
        normal = np.swapaxes(unit, 1, 2) @ (self._weights(offset) @ unit)
        determinant = normal[:, 0, 0] * normal[:, 1, 1] - normal[:, 0, 1] ** 2
        trace = normal[:, 0, 0] + normal[:, 1, 1]
        singular = ~(determinant > 1e-8 * trace**2)
        safe = np.where(singular, 1.0, determinant)
        inverse = np.empty_like(normal)
        inverse[:, 0, 0] = normal[:, 1, 1] / safe
        inverse[:, 1, 1] = normal[:, 0, 0] / safe
        inverse[:, 0, 1] = inverse[:, 1, 0] = -normal[:, 0, 1] / safe
        return inverse, singular

    def least_chi2_within(self, radius: float) -> Floats:
        """Least χ² over a disc about the claim, on lines towards the anchors, as the decision searches it."""
        claim = np.zeros((len(self.middle), 2))
        weights = self._weights(claim)
        toward = self.middle[:, :2] - self.anchors[:, :2].mean(axis=0)
        unit = toward / np.maximum(np.linalg.norm(toward, axis=1), 1e-9)[:, None]
        across = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
        _, residual = self._directions(claim)
        best = np.einsum("bi,bij,bj->b", residual, weights, residual)
        for line in range(-LINES, LINES + 1):
            aside = radius * line / LINES
            half = np.sqrt(max((radius - aside) * (radius + aside), 0.0))
            along = np.zeros(len(claim))
            for _ in range(LINE_STEPS):
                sight, residual = self._directions(aside * across + along[:, None] * unit)
                slope = np.einsum("bai,bi->ba", sight, unit)
                weighed = np.einsum("bij,bj->bi", weights, slope)
                best = np.minimum(best, np.einsum("bi,bij,bj->b", residual, weights, residual))
                curvature = np.maximum((weighed * slope).sum(axis=1), 1e-300)
                along = np.clip(along + (weighed * residual).sum(axis=1) / curvature, -half, half)
        return np.asarray(best, dtype=np.float64)

    def linear_start(self) -> Floats:
        """Offset from differences of squared ranges: needs no start, so that a lie of any size is found."""
        base, others = self.anchors[0], self.anchors[1:]
        slope = 2.0 * (others[:, :2] - base[:2])
        up = self.middle[:, 2]
        height = (up - base[2])[:, None] ** 2 - (up[:, None] - others[:, 2]) ** 2
        value = self.virtual[:, :1] ** 2 - self.virtual[:, 1:] ** 2 - height
        value = value + (others[:, :2] ** 2).sum(axis=1) - (base[:2] ** 2).sum()
        gain = np.linalg.pinv(slope)
        return np.asarray(value @ gain.T - self.middle[:, :2], dtype=np.float64)

    def _directions(self, offset: Floats) -> tuple[Floats, Floats]:
        """Unit vectors from each anchor, (B, A, 2), and residuals, (B, A)."""
        x = self.middle[:, None, 0] + offset[:, None, 0] - self.anchors[:, 0]
        y = self.middle[:, None, 1] + offset[:, None, 1] - self.anchors[:, 1]
        z = self.middle[:, None, 2] - self.anchors[:, 2]
        away = np.maximum(np.sqrt(x * x + y * y + z * z), 1.0)
        return np.stack((x / away, y / away), axis=2), self.virtual - away

    def _weights(self, offset: Floats) -> Floats:
        x = self.middle[:, None, 0] + offset[:, None, 0] - self.anchors[:, 0]
        y = self.middle[:, None, 1] + offset[:, None, 1] - self.anchors[:, 1]
        z = self.middle[:, None, 2] - self.anchors[:, 2]
        away = np.maximum(np.sqrt(x * x + y * y + z * z), 1.0)
        # Sherman and Morrison, twice, as the decision does.
        inverse = 1.0 / self.own
        rows = inverse[:, :, None] * np.eye(self.anchors.shape[0])
        for sigma, vector in ((self.installation, np.ones_like(away)), (self.height, z / away)):
            product = (rows @ vector[:, :, None])[:, :, 0]
            scale = 1.0 / sigma**2 + (vector * product).sum(axis=1)
            rows = rows - product[:, :, None] * product[:, None, :] / scale[:, None, None]
        return np.asarray(rows, dtype=np.float64)


def _solve2(normal: Floats, right: Floats) -> Floats:
    determinant = normal[:, 0, 0] * normal[:, 1, 1] - normal[:, 0, 1] ** 2
    safe = np.where(np.abs(determinant) > 1e-300, determinant, np.inf)
    x = (normal[:, 1, 1] * right[:, 0] - normal[:, 0, 1] * right[:, 1]) / safe
    y = (normal[:, 0, 0] * right[:, 1] - normal[:, 0, 1] * right[:, 0]) / safe
    return np.stack((x, y), axis=1)
