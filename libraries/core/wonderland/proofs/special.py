"""Functions of statistics from + − × ÷ and √ alone: the same bits on every endorser.

IEEE 754 rounds those five exactly; the exponential of a machine's mathematics library it does not define, so libm has
no place in a contract. Nor have ``sum()`` (changed in Python 3.12), ``**``, ``hypot`` or ``fsum``.

Bounds, measured against mpmath over the whole range (``tests/proofs/test_special.py``): ``exp_negative`` relative
1e-15 above 1e-300; ``normal_half`` absolute 2e-15.
"""

from __future__ import annotations

from typing import Final

_LN2_HIGH: Final = 6.93147180369123816490e-01  # ln 2 in two parts, so that k·ln 2 loses nothing (Cody and Waite)
_LN2_LOW: Final = 1.90821492927058770002e-10
_INVERSE_LN2: Final = 1.44269504088896338700
_INVERSE_SQRT_2PI: Final = 0.3989422804014327
_SMALLEST_EXPONENT: Final = -700.0


def _negative_powers_of_two(count: int) -> tuple[float, ...]:
    values = [1.0]
    for _ in range(1, count):
        values.append(values[-1] * 0.5)
    return tuple(values)


_F3: Final = 1.0 / 6.0
_F4: Final = 1.0 / 24.0
_F5: Final = 1.0 / 120.0
_F6: Final = 1.0 / 720.0
_F7: Final = 1.0 / 5_040.0
_F8: Final = 1.0 / 40_320.0
_F9: Final = 1.0 / 362_880.0
_F10: Final = 1.0 / 3_628_800.0
_F11: Final = 1.0 / 39_916_800.0
_F12: Final = 1.0 / 479_001_600.0
_F13: Final = 1.0 / 6_227_020_800.0
_HALVES: Final = _negative_powers_of_two(1074)


def exp_negative(x: float) -> float:
    """e^x for x ≤ 0; 0 below −700."""
    if x < _SMALLEST_EXPONENT:
        return 0.0
    k = int(0.5 - x * _INVERSE_LN2)
    r = (x + k * _LN2_HIGH) + k * _LN2_LOW
    # Σ rⁿ/n! to n = 13 by Horner's rule, written out: a verdict needs hundreds of them.
    total = (((((_F13 * r + _F12) * r + _F11) * r + _F10) * r + _F9) * r + _F8) * r + _F7
    total = ((((((total * r + _F6) * r + _F5) * r + _F4) * r + _F3) * r + 0.5) * r + 1.0) * r + 1.0
    return total * _HALVES[k]


# Φ(z) − ½ in pieces: a Taylor polynomial of degree 9 about each multiple of 1/8.
_STEPS_PER_UNIT: Final = 8
"""A power of two, so that ``normal_half`` may multiply by its inverse and be exact."""
LAST: Final = 8.25
"""Beyond this Φ is 1 to the last bit."""
_DEGREE: Final = 9


def _normal_half_series(z: float) -> float:
    """Φ(z) − ½ = φ(z)·Σ z^(2n+1)/(1·3·5…); all terms are positive, so nothing cancels."""
    term = total = z
    n = 1
    while term > total * 1e-18:
        n += 2
        term = term * z * z / n
        total += term
    return _INVERSE_SQRT_2PI * exp_negative(-0.5 * z * z) * total


def _piece(z: float) -> tuple[float, ...]:
    """Taylor coefficients of Φ − ½ about z: φ's derivatives by f(n+1) = −z·f(n) − n·f(n−1)."""
    density = _INVERSE_SQRT_2PI * exp_negative(-0.5 * z * z)
    derivatives = [1.0, -z]
    for n in range(1, _DEGREE):
        derivatives.append(-z * derivatives[n] - n * derivatives[n - 1])
    coefficients = [_normal_half_series(z) if z > 0.0 else 0.0]
    factorial = 1.0
    for n in range(_DEGREE):
        factorial *= n + 1
        coefficients.append(density * derivatives[n] / factorial)
    return tuple(coefficients)


_PIECES: Final = tuple(_piece(k / _STEPS_PER_UNIT) for k in range(int(LAST * _STEPS_PER_UNIT) + 2))


def normal_half(z: float) -> float:
    """Φ(z) − ½ of the standard normal distribution."""
    if z < 0.0:
        return -normal_half(-z)
    if z > LAST:
        return 0.5
    k = int(z * 8.0 + 0.5)
    d = z - k * 0.125
    a0, a1, a2, a3, a4, a5, a6, a7, a8, a9 = _PIECES[k]
    return a0 + d * (a1 + d * (a2 + d * (a3 + d * (a4 + d * (a5 + d * (a6 + d * (a7 + d * (a8 + d * a9))))))))


CHI2_LIMITS: Final = (
    10.827566170662733,
    13.815510557964274,
    16.26623619623813,
    18.466826952903173,
    20.515005652432876,
    22.457744484825323,
    24.321886347856854,
    26.124481558376143,
    27.877164871256575,
    29.58829844507442,
    31.26413362023999,
    32.90949040736021,
    34.52817897487089,
    36.12327368039814,
)
"""χ² that 1 in 1000 exceeds by chance, for 1 to 14 degrees of freedom (sixteen anchors, two unknowns)."""
CHI2_MILLIONTH: Final = (
    23.928126976934827,
    27.631021115928547,
    30.664849706213598,
    33.37684158171984,
    35.888186879672865,
    38.25833637720969,
    40.521831234179864,
    42.700913926544274,
    44.81093787068782,
    46.863046846784385,
    48.86564276320364,
    50.825252138874454,
    52.747068114203024,
    54.63530553003881,
)
"""χ² that 1 in 1,000,000 exceeds by chance."""
