"""Weights times what is known of each anchor: the innermost loops of both fixes (``estimate``, ``hyperbolic``).

Most pads have four anchors; for them the sums are written out, which takes half the time. The order of the additions,
and so each bit, is the same for any number of anchors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

Weights = Sequence[Sequence[float]]
"""A row for each anchor."""
Pair = tuple[float, float]
Line = tuple[float, float, float, float]
_WRITTEN_OUT: Final = 4


def dot(one: Sequence[float], other: Sequence[float]) -> float:
    """Sum of the products."""
    if len(one) == _WRITTEN_OUT:
        a0, a1, a2, a3 = one
        b0, b1, b2, b3 = other
        return a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3
    total = 0.0
    for a, b in zip(one, other, strict=True):
        total += a * b
    return total


def weighed_pairs(weights: Weights, pairs: Sequence[Pair]) -> list[Pair]:
    """For each row of the weights: its sums over the pairs' two columns."""
    if len(pairs) == _WRITTEN_OUT:
        (a0, b0), (a1, b1), (a2, b2), (a3, b3) = pairs
        return [
            (w0 * a0 + w1 * a1 + w2 * a2 + w3 * a3, w0 * b0 + w1 * b1 + w2 * b2 + w3 * b3) for w0, w1, w2, w3 in weights
        ]
    sums = []
    for row in weights:
        a = b = 0.0
        for weight, (of_a, of_b) in zip(row, pairs, strict=True):
            a += weight * of_a
            b += weight * of_b
        sums.append((a, b))
    return sums


def weighed_lines(weights: Weights, lines: Sequence[Line]) -> list[Line]:
    """For each row of the weights: its sums over the lines' four columns."""
    if len(lines) == _WRITTEN_OUT:
        (a0, b0, c0, d0), (a1, b1, c1, d1), (a2, b2, c2, d2), (a3, b3, c3, d3) = lines
        return [
            (
                w0 * a0 + w1 * a1 + w2 * a2 + w3 * a3,
                w0 * b0 + w1 * b1 + w2 * b2 + w3 * b3,
                w0 * c0 + w1 * c1 + w2 * c2 + w3 * c3,
                w0 * d0 + w1 * d1 + w2 * d2 + w3 * d3,
            )
            for w0, w1, w2, w3 in weights
        ]
    sums = []
    for row in weights:
        a = b = c = d = 0.0
        for weight, (of_a, of_b, of_c, of_d) in zip(row, lines, strict=True):
            a += weight * of_a
            b += weight * of_b
            c += weight * of_c
            d += weight * of_d
        sums.append((a, b, c, d))
    return sums


def normal_on_the_map(weights: Weights, lines: Sequence[Line]) -> tuple[float, float, float, float, float, float]:
    """Normal equations on the map (ee, en, nn; right side e, n) and χ². ``lines``: east, north, up, residual."""
    ee = en = nn = be = bn = chi2 = 0.0
    if len(lines) == _WRITTEN_OUT:
        (e0, n0, _, r0), (e1, n1, _, r1), (e2, n2, _, r2), (e3, n3, _, r3) = lines
        for (w0, w1, w2, w3), (ue, un, _, residual) in zip(weights, lines, strict=True):
            wn = w0 * n0 + w1 * n1 + w2 * n2 + w3 * n3
            wr = w0 * r0 + w1 * r1 + w2 * r2 + w3 * r3
            ee += ue * (w0 * e0 + w1 * e1 + w2 * e2 + w3 * e3)
            en += ue * wn
            nn += un * wn
            be += ue * wr
            bn += un * wr
            chi2 += residual * wr
        return ee, en, nn, be, bn, max(chi2, 0.0)
    for (we, wn, _, wr), (ue, un, _, residual) in zip(weighed_lines(weights, lines), lines, strict=True):
        ee += ue * we
        en += ue * wn
        nn += un * wn
        be += ue * wr
        bn += un * wr
        chi2 += residual * wr
    return ee, en, nn, be, bn, max(chi2, 0.0)


def with_shared_error(inverse: Sequence[float], sigma: float) -> tuple[float, Weights]:
    """(α, diag(d) − α·ddᵀ): the inverse of diag(1/d) + sigma²·11ᵀ, an error of each and one that all share."""
    total = 0.0
    for each in inverse:
        total += each
    alpha = 1.0 / (1.0 / (sigma * sigma) + total) if sigma > 0.0 else 0.0
    rows = []
    for position, left in enumerate(inverse):
        shared = alpha * left
        row = [0.0 - shared * right for right in inverse]
        row[position] = left - shared * left
        rows.append(row)
    return alpha, rows


def less_outer(weights: Weights, column: Sequence[float], factor: float) -> Weights:
    """The weights minus ``factor`` times the outer product of a column with itself."""
    if len(column) == _WRITTEN_OUT:
        c0, c1, c2, c3 = column
        scaled = [factor * value for value in column]
        return [
            (w0 - f * c0, w1 - f * c1, w2 - f * c2, w3 - f * c3)
            for (w0, w1, w2, w3), f in zip(weights, scaled, strict=True)
        ]
    rows = []
    for row, left in zip(weights, column, strict=True):
        scaled_left = factor * left
        rows.append([weight - scaled_left * right for weight, right in zip(row, column, strict=True)])
    return rows
