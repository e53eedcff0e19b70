from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from wonderland.proofs.likelihood import Matrix2, about_the_middle, distance_to_disc, distance_to_outside, inside_disc


def covariance(s1, s2, angle):
    c, s = math.cos(angle), math.sin(angle)
    return Matrix2(s1 * s1 * c * c + s2 * s2 * s * s, (s1 * s1 - s2 * s2) * c * s, s1 * s1 * s * s + s2 * s2 * c * c)


def exact(m1, m2, s1, s2, radius):
    """Adaptive quadrature over the minor axis: the normal mass of each chord along the major one."""

    def density(v):
        half = math.sqrt(max(0.0, radius * radius - v * v))
        return stats.norm.pdf(v, m2, s2) * (stats.norm.cdf((half - m1) / s1) - stats.norm.cdf((-half - m1) / s1))

    inner = (m2 + k * s2 for k in (-8, -4, -2, -1, 0, 1, 2, 4, 8))
    edges = sorted({-radius, radius, *(x for x in inner if abs(x) < (1 - 1e-9) * radius)})
    return sum(integrate.quad(density, a, b, epsabs=1e-11, limit=200)[0] for a, b in itertools.pairwise(edges))


@given(st.floats(0.01, 20), st.floats(0.02, 1), st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 6.3))
@settings(deadline=None, max_examples=80)
def test_probability_against_scipy(s1, ratio, m1, m2, angle):
    radius, s2 = 1000.0, s1 * ratio
    m1, m2, s1, s2 = (value * radius for value in (m1, m2, s1, s2))
    c, s = math.cos(angle), math.sin(angle)
    got = inside_disc(m1 * c - m2 * s, m1 * s + m2 * c, covariance(s1, s2, angle), radius)
    assert got == pytest.approx(exact(m1, m2, s1, s2, radius), abs=1e-6)


def test_isotropic_closed_form():
    assert inside_disc(0, 0, Matrix2(250_000, 0, 250_000), 1000.0) == pytest.approx(1 - math.exp(-2), abs=1e-8)


@given(st.floats(0.003, 100), st.floats(0.001, 1), st.floats(0, 6.3))
@settings(deadline=None, max_examples=80)
def test_about_the_middle_half_of_it_is_enough(s1, ratio, angle):
    c = covariance(1000.0 * s1, 1000.0 * s1 * ratio, angle)
    assert about_the_middle(c, 1000.0) == pytest.approx(inside_disc(0, 0, c, 1000.0), abs=1e-13)


def test_a_sure_estimate():
    assert about_the_middle(Matrix2(0, 0, 0), 1000.0) == 1.0
    assert inside_disc(0, 0, Matrix2(0, 0, 0), 1000.0) == 1.0
    assert inside_disc(1001, 0, Matrix2(0, 0, 0), 1000.0) == 0.0
    assert inside_disc(1e7, 0, Matrix2(100, 0, 100), 1000.0) == 0.0


@given(st.floats(1.05, 30), st.floats(0, 6.3), st.floats(10, 400), st.floats(0.05, 1))
@settings(deadline=None, max_examples=60)
def test_distance_to_the_disc_is_the_least_over_a_fine_circle(away, angle, s1, ratio):
    c = covariance(s1, s1 * ratio, 0.7)
    east, north = away * 1000 * math.cos(angle), away * 1000 * math.sin(angle)
    det = c.ee * c.nn - c.en**2
    angles = np.linspace(0, math.tau, 400_000)
    dx, dy = east - 1000 * np.cos(angles), north - 1000 * np.sin(angles)
    least = math.sqrt(((c.nn * dx * dx - 2 * c.en * dx * dy + c.ee * dy * dy) / det).min())
    assert distance_to_disc(east, north, c, 1000.0) == pytest.approx(least, rel=2e-3, abs=5e-3)


@given(st.floats(0, 0.99), st.floats(0, 6.3), st.floats(10, 4000), st.floats(0.05, 1))
@settings(deadline=None, max_examples=60)
def test_distance_to_the_outside_is_the_least_over_a_fine_circle(share, angle, s1, ratio):
    c = covariance(s1, s1 * ratio, 0.7)
    east, north = share * 1000 * math.cos(angle), share * 1000 * math.sin(angle)
    det = c.ee * c.nn - c.en**2
    angles = np.linspace(0, math.tau, 400_000)
    dx, dy = east - 1000 * np.cos(angles), north - 1000 * np.sin(angles)
    least = math.sqrt(((c.nn * dx * dx - 2 * c.en * dx * dy + c.ee * dy * dy) / det).min())
    assert distance_to_outside(east, north, c, 1000.0) == pytest.approx(least, rel=2e-3, abs=5e-3)
    assert distance_to_disc(east, north, c, 1000.0) == 0.0


def test_an_estimate_on_the_minor_axis_has_two_nearest_points():
    # 300 mm off centre across a long ellipse: the circle is nearest far along the major axis, not straight ahead.
    across = distance_to_outside(0.0, 300.0, Matrix2(900.0**2, 0.0, 50.0**2), 1000.0)
    least = min(
        math.hypot(1000 * math.cos(a / 1e5) / 900, (1000 * math.sin(a / 1e5) - 300) / 50) for a in range(157_080)
    )
    assert across == pytest.approx(least, rel=1e-4)
