from __future__ import annotations

import mpmath
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from wonderland.proofs.special import CHI2_LIMITS, exp_negative, normal_half


@given(st.floats(-690, 0))
@settings(deadline=None, max_examples=300)
def test_exponential_against_mpmath(x):
    with mpmath.workdps(40):
        exact = mpmath.exp(mpmath.mpf(x))
        assert abs(exp_negative(x) - exact) <= 1e-15 * exact


@given(st.floats(-9, 9))
@settings(deadline=None, max_examples=300)
def test_normal_against_mpmath(z):
    with mpmath.workdps(40):
        exact = mpmath.ncdf(mpmath.mpf(z)) - mpmath.mpf("0.5")
        assert abs(normal_half(z) - exact) < 2e-15


def test_limits():
    assert exp_negative(-1000.0) == 0.0
    assert exp_negative(0.0) == 1.0
    assert normal_half(40.0) == 0.5
    assert pytest.approx([stats.chi2.isf(1e-3, k) for k in range(1, 15)]) == CHI2_LIMITS
