"""How likely the drone is within the buffer of its claim, and how far outside it surely is.

The estimate of the offset from the claim is Gaussian with a covariance; its mass inside a disc about the claim has no
closed form. The minor axis is integrated by Gauss–Legendre quadrature (2 × 24 nodes), the major one is a difference of
normal distributions; the substitution v = 2Rt/(1+t²), h = R(1−t²)/(1+t²) takes the root out of the circle. Largest
error over 0.003 R ≤ s1 ≤ 100 R: 4e-8 (``tests/proofs/test_likelihood.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import Final, NamedTuple

from wonderland.proofs.special import LAST, exp_negative, normal_half

_POSITIVE_NODES: Final = (
    (0.06405689286260563, 0.12793819534675202),
    (0.1911188674736163, 0.12583745634682825),
    (0.3150426796961634, 0.1216704729278033),
    (0.4337935076260451, 0.11550566805372552),
    (0.5454214713888396, 0.10744427011596556),
    (0.6480936519369755, 0.09761865210411393),
    (0.7401241915785544, 0.0861901615319532),
    (0.820001985973903, 0.07334648141108016),
    (0.8864155270044011, 0.05929858491543636),
    (0.9382745520027328, 0.04427743881741941),
    (0.9747285559713095, 0.02853138862893356),
    (0.9951872199970213, 0.01234122979998869),
)
"""Positive half of the 24 Gauss–Legendre nodes with their weights."""
_NODES: Final = tuple((sign * node, weight) for node, weight in _POSITIVE_NODES for sign in (-1.0, 1.0))
_PIECES: Final = 2
_REACH: Final = 6.5
"""Standard deviations beyond which a normal distribution holds less than 1e-10."""
_INVERSE_SQRT_2PI: Final = 0.3989422804014327
_SMALLEST_RATIO: Final = 1e-6
_HALVINGS: Final = 60
_DOUBLINGS: Final = 200
_NOT_QUITE_ZERO: Final = 1e-9
"""An estimate exactly on the minor axis has two nearest points; this much off it has one, as far away."""
LARGE_DISTANCE: Final = 1e9
"""Distance, in standard deviations, of what is known exactly."""


class Ellipse(NamedTuple):
    """A horizontal covariance by its axes: standard deviations s1 ≥ s2 in mm, and the major axis' direction."""

    s1: float
    s2: float
    east: float
    north: float


@dataclass(slots=True)
class Matrix2:
    """A symmetric 2 × 2 matrix in mm²: east-east, east-north, north-north.

    Never changed; to freeze it would treble the time that a verdict spends on matrices.
    """

    ee: float
    en: float
    nn: float
    _axes: Ellipse | None = field(default=None, init=False, repr=False, compare=False)

    def __add__(self, other: Matrix2) -> Matrix2:
        return Matrix2(self.ee + other.ee, self.en + other.en, self.nn + other.nn)

    def scaled(self, factor: float) -> Matrix2:
        """Each element times ``factor``."""
        return Matrix2(self.ee * factor, self.en * factor, self.nn * factor)

    def along(self, east: float, north: float) -> float:
        """Variance along a unit direction."""
        return self.ee * east * east + 2.0 * self.en * east * north + self.nn * north * north

    def ellipse(self) -> Ellipse:
        """Axes of the covariance; a variance that rounding made negative counts as tiny."""
        if self._axes is None:  # a verdict asks for the same ones again and again
            self._axes = self._ellipse()
        return self._axes

    def _ellipse(self) -> Ellipse:
        half_difference = 0.5 * (self.ee - self.nn)
        root = sqrt(half_difference * half_difference + self.en * self.en)
        large = 0.5 * (self.ee + self.nn) + root
        if large <= 0.0:
            return Ellipse(0.0, 0.0, 1.0, 0.0)
        small = (self.ee * self.nn - self.en * self.en) / large
        small = max(small, large * _SMALLEST_RATIO)
        if root == 0.0:
            return Ellipse(sqrt(large), sqrt(small), 1.0, 0.0)
        if half_difference >= 0.0:
            east, north = half_difference + root, self.en
        else:
            east, north = self.en, root - half_difference
        length = sqrt(east * east + north * north)
        return Ellipse(sqrt(large), sqrt(small), east / length, north / length)


def inside_disc(east: float, north: float, covariance: Matrix2, radius: float) -> float:
    """P(‖x‖ ≤ radius) for x ~ N((east, north), covariance): the drone is within the buffer of its claim."""
    axes = covariance.ellipse()
    if axes.s1 <= 0.0:
        return 1.0 if east * east + north * north <= radius * radius else 0.0
    major = abs(east * axes.east + north * axes.north)
    minor = abs(north * axes.east - east * axes.north)
    low, high = minor - _REACH * axes.s2, minor + _REACH * axes.s2
    limit = radius
    beyond = major - _REACH * axes.s1
    if beyond > 0.0:
        if beyond >= radius:
            return 0.0
        limit = sqrt((radius - beyond) * (radius + beyond))
    low, high = max(low, -limit), min(high, limit)
    if low >= high:
        return 0.0
    start = low / (radius + sqrt((radius - low) * (radius + low)))
    end = high / (radius + sqrt((radius - high) * (radius + high)))
    inverse1, inverse2 = 1.0 / axes.s1, 1.0 / axes.s2
    half = 0.5 * (end - start) / _PIECES
    diameter = 2.0 * radius
    total = 0.0
    for piece in range(_PIECES):
        middle = start + half * (2 * piece + 1)
        for node, weight in _NODES:
            t = middle + half * node
            square = t * t
            q = 1.0 / (1.0 + square)
            h = radius * (1.0 - square) * q
            z = (diameter * t * q - minor) * inverse2
            nearer = (h - major) * inverse1
            if nearer > LAST:
                mass = 1.0
            else:
                farther = (h + major) * inverse1
                mass = normal_half(nearer) + (0.5 if farther > LAST else normal_half(farther))
            total += weight * exp_negative(-0.5 * z * z) * mass * q * h
    result = total * half * 2.0 * _INVERSE_SQRT_2PI * inverse2
    return min(result, 1.0)


def about_the_middle(covariance: Matrix2, radius: float) -> float:
    """``inside_disc`` of (0, 0), a third as long: both halves are alike, and so are near and far side.

    Not to the last bit: no verdict may rest on it.
    """
    axes = covariance.ellipse()
    if axes.s1 <= 0.0:
        return 1.0
    high = min(_REACH * axes.s2, radius)
    half = 0.5 * high / (radius + sqrt((radius - high) * (radius + high)))
    inverse1, inverse2 = 1.0 / axes.s1, 1.0 / axes.s2
    total = 0.0
    for node, weight in _NODES:
        t = half + half * node
        square = t * t
        h = radius / (1.0 + square)
        z = 2.0 * h * t * inverse2
        h *= 1.0 - square
        total += weight * exp_negative(-0.5 * z * z) * normal_half(h * inverse1) * h / (1.0 + square)
    return min(total * half * 8.0 * _INVERSE_SQRT_2PI * inverse2, 1.0)


def distance_to_disc(east: float, north: float, covariance: Matrix2, radius: float) -> float:
    """Mahalanobis distance from the estimate to the nearest point of the disc; 0 inside it."""
    if east * east + north * north <= radius * radius:
        return 0.0
    return _distance_to_circle(east, north, covariance, radius)


def distance_to_outside(east: float, north: float, covariance: Matrix2, radius: float) -> float:
    """Mahalanobis distance from the estimate to the nearest point outside of the disc; 0 outside."""
    if east * east + north * north >= radius * radius:
        return 0.0
    return _distance_to_circle(east, north, covariance, radius)


def _distance_to_circle(east: float, north: float, covariance: Matrix2, radius: float) -> float:
    """Least Mahalanobis distance to a point of the circle.

    In the ellipse's axes the nearest point is x = m/(1 + λs²) with |x| = radius; |x| falls with λ, so that halving
    finds λ: above zero for an estimate outside, between −1/s1² and zero for one inside.
    """
    axes = covariance.ellipse()
    if axes.s1 <= 0.0:
        return LARGE_DISTANCE
    # All lengths in units of s1, so that one scale serves millimetres and kilometres.
    scale = 1.0 / axes.s1
    ratio = axes.s2 * scale
    ratio2 = ratio * ratio
    reach = radius * scale
    major = max(abs(east * axes.east + north * axes.north) * scale, reach * _NOT_QUITE_ZERO)
    minor = abs(north * axes.east - east * axes.north) * scale
    square = reach * reach
    outside = major * major + minor * minor > square
    low, high = (1.0, 1.0) if outside else (0.0, 1.0)
    if outside:
        for _ in range(_DOUBLINGS):
            high += high
            if _beyond(major, minor, ratio2, high) <= square:
                break
            low = high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        x, y = major / middle, minor / (1.0 + (middle - 1.0) * ratio2)
        if x * x + y * y > square:
            low = middle
        else:
            high = middle
    mu = high  # 1 + λ·s1²
    shrunk = 1.0 + (mu - 1.0) * ratio2
    along = major - major / mu
    across = (minor - minor / shrunk) / ratio
    return sqrt(along * along + across * across)


def _beyond(major: float, minor: float, ratio2: float, mu: float) -> float:
    """|x|² of the candidate; infinite where its denominator vanishes."""
    if mu <= 0.0:
        return LARGE_DISTANCE * LARGE_DISTANCE
    x = major / mu
    y = minor / (1.0 + (mu - 1.0) * ratio2)
    return x * x + y * y
