"""A GNSS receiver: slowly wandering errors, an accuracy that it honestly reports, and what spoofers do to it."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from typing import Protocol

from wonderland_simulator.flight import Vector

PER_95_HORIZONTAL = 2.4477
"""95 % radius of a circular normal distribution of standard deviation 1."""
PER_95_VERTICAL = 1.96


class Spoofing(Protocol):
    """What is added to a receiver's position, without it noticing: flags and reported accuracy stay unchanged."""

    def offset(self, t_s: float) -> Vector:
        """East, north, up in metres at a time in seconds."""
        ...


@dataclass(frozen=True)
class NoSpoofing:
    """The sky as it is."""

    def offset(self, t_s: float) -> Vector:
        """No offset, at any time."""
        del t_s
        return (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SlowDrag:
    """Drags the position away so slowly that no filter complains: 1 m/s went unnoticed by a real autopilot."""

    start_s: float
    speed_m_s: float = 1.0
    bearing_deg: float = 60.0
    limit_m: float = 25.0

    def offset(self, t_s: float) -> Vector:
        """A straight line in the bearing, up to the limit."""
        size = min(max(0.0, t_s - self.start_s) * self.speed_m_s, self.limit_m)
        angle = math.radians(self.bearing_deg)
        return (size * math.sin(angle), size * math.cos(angle), 0.0)


@dataclass(frozen=True)
class Jump:
    """Puts the position elsewhere at once."""

    start_s: float
    east_m: float
    north_m: float

    def offset(self, t_s: float) -> Vector:
        """All of it from the start on."""
        return (self.east_m, self.north_m, 0.0) if t_s >= self.start_s else (0.0, 0.0, 0.0)


@dataclass
class Gnss:
    """A receiver with first-order Gauss–Markov errors.

    ``sigma_m``: standard deviation in each horizontal axis; height has 1.6 times that, as with real receivers.
    """

    rng: random.Random
    sigma_m: float
    correlation_s: float = 30.0
    spoofing: Spoofing = field(default_factory=NoSpoofing)
    _error: Vector = (0.0, 0.0, 0.0)
    _last_s: float | None = None

    def fix(self, truth: Vector, t_s: float) -> Vector:
        """What the receiver says at a time, where the drone truly is at ``truth``."""
        sigmas = (self.sigma_m, self.sigma_m, self.sigma_m * 1.6)
        if self._last_s is None:
            self._error = tuple(self.rng.gauss(0.0, sigma) for sigma in sigmas)  # type: ignore[assignment]
        else:
            keep = math.exp(-max(0.0, t_s - self._last_s) / self.correlation_s)
            drive = math.sqrt(1.0 - keep * keep)
            self._error = tuple(  # type: ignore[assignment]
                error * keep + self.rng.gauss(0.0, sigma) * drive
                for error, sigma in zip(self._error, sigmas, strict=True)
            )
        self._last_s = t_s
        offset = self.spoofing.offset(t_s)
        x, y, z = (a + b + c for a, b, c in zip(truth, self._error, offset, strict=True))
        return (x, y, z)

    @property
    def accuracy_mm(self) -> int:
        """Horizontal, 95 %."""
        return max(1, round(self.sigma_m * PER_95_HORIZONTAL * 1000))

    @property
    def height_accuracy_mm(self) -> int:
        """Vertical, 95 %."""
        return max(1, round(self.sigma_m * 1.6 * PER_95_VERTICAL * 1000))
