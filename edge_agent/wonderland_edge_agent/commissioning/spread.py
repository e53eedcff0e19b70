"""How well the curves are known: from errors of windows that were held out of the fit.

Four parts, because they behave differently in a verdict: white noise (more rounds help), its correlation from round to
round (they help less), what all anchors have in common (the installation: it moves the distance, not the bearing), and
each anchor's own remaining bias by distance (nothing helps). What a window shows is divided among them and stated once;
at least half of it counts as bias, for a hovering drone keeps the reflections of its place for a whole session.

Variances are estimated hierarchically: each anchor's at a distance is drawn towards what all anchors show there, and
that towards what is known of the chip, by how many independent seconds there are. Seconds in which something stood
between an anchor and the drone (``sight``) are left out: a verdict's own tests deal with those, and one σ for both
would make every session vague.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtri, stdtrit

from wonderland_edge_agent.commissioning import prior
from wonderland_edge_agent.commissioning.curves import ALIKE_S, BLOCK_S, Curves
from wonderland_edge_agent.commissioning.run import Floats, Windows
from wonderland_edge_agent.commissioning.sight import all_in_sight

MOST_CORRELATED: Final = 0.9
SIGMA_FLOOR_M: Final = 0.005
BIAS_FLOOR_M: Final = 0.003
COVERED: Final = 0.99
"""A standard deviation that is itself only estimated is stated so large that a normal distribution with it covers this
much of what is to come, as Student's does with the estimate: a short run claims less. It is what a policy verifies
with; an upper limit would make likelihoods too modest in the middle."""
NEIGHBOURS: Final = 60
"""Windows of an anchor that a local standard deviation rests on."""
PRIOR_WINDOWS: Final = 20.0
"""Weight of all anchors' spread at a distance in each anchor's own."""
PRIOR_SAMPLES: Final = 3.0
"""How many independent samples the chip's published spread is worth: it tells a σ to about a factor of two."""
PRIOR_OWN_M: Final = prior.BIAS_SIGMA_MM / 1000
PRIOR_COMMON_M: Final = prior.INSTALLATION_MM / 1000
DAY_TO_DAY_M: Final = 0.015
"""What another day may change for all anchors (a DW1000's range moves by about 2 mm/°C), where one run alone cannot
show it."""
SLOPE_M_PER_M: Final = 0.02
"""Steepest change of bias with distance that radios show: where a curve is not covered, it may drift off so fast."""
OBSTRUCTED_M: Final = 0.15
CLEAR: Final = 0.5
"""Seconds that are less probably in line of sight do not count."""
_TWO_SIGMA: Final = 0.9545
_LEAST_SHARE: Final = 0.5
"""Of the windows' variance, at least this counts as bias, whatever their noise would explain."""
_CLOSEST: Final = 5
_DISTURBED: Final = 10.0


@dataclass(frozen=True)
class Spread:
    """Standard deviations in metres."""

    range_sigma_m: float
    correlation: float
    """Effective correlation from one round to the next."""
    installation_m: float
    bias_sigma_m: Floats
    """(a, k): of each anchor's remaining bias at each knot."""
    common_m: Floats
    """What all anchors had in common in each window (w,)."""
    own_m: Floats
    """What is left of each (w, a)."""
    lags: Floats
    """Autocorrelation of the noise within windows by lag, from lag 0."""
    in_sight: Floats
    """Share of each anchor's seconds in line of sight (a,)."""


def find_spread(data: Windows, curves: Curves, held: Floats, *, reference_sigma_m: float) -> Spread:
    """All parts. ``held`` (w, a): errors of windows with curves that did not see them."""
    anchors = held.shape[1]
    present = np.isfinite(held)
    whole = present.sum(axis=1) >= min(3, anchors)
    common = np.full(len(held), np.nan)
    common[whole] = [_centre(row[np.isfinite(row)]) for row in held[whole]]
    # Around their own centre a windows' anchors vary by (a - 1)/a of what each varies.
    own = (held - common[:, None]) * np.sqrt(anchors / max(anchors - 1, 1))
    clear = all_in_sight(own, data.first_path_db)
    sight = np.where(np.isfinite(own), clear, 0.0).sum(axis=0) / np.maximum(np.isfinite(own).sum(axis=0), 1)
    own = np.where(clear >= CLEAR, own, np.nan)
    noise = _noise(data, own)
    apart = max(1.0, ALIKE_S / data.length_s)
    global_own = _scale(own[np.isfinite(own)])
    bias_sigma = _local(data, curves, own, noise.explained, global_own, apart)
    bias_sigma = np.sqrt(bias_sigma**2 + reference_sigma_m**2)
    shared2 = max(_scale(common[np.isfinite(common)]) ** 2 - global_own**2 / anchors, 0.0)
    alike = apart if data.run.max() == 0 else max(BLOCK_S / data.length_s, 1.0)
    independent = float(np.isfinite(common).sum()) / alike
    installation = np.sqrt(shrunk(shared2, independent, PRIOR_COMMON_M**2, PRIOR_SAMPLES))
    if data.run.max() == 0:
        installation = np.hypot(installation, DAY_TO_DAY_M)
    else:
        means = [float(np.nanmedian(common[data.run == index])) for index in range(int(data.run.max()) + 1)]
        between = float(np.std(means, ddof=0)) * np.sqrt(inflation(len(means) - 1.0))
        installation = max(installation, between, DAY_TO_DAY_M / np.sqrt(len(means)))
    return Spread(noise.sigma, noise.correlation, float(installation), bias_sigma, common, own, noise.lags, sight)


@dataclass(frozen=True)
class _Noise:
    """What changes within seconds. Lengths in metres."""

    sigma: float
    correlation: float
    explained: float
    """Part of the variance of a window's mean that is noise and not bias."""
    lags: Floats


def _noise(data: Windows, own: Floats) -> _Noise:
    """σ from within windows; its correlation from how much neighbouring windows' means differ (Allan's variance).

    Were the noise white, means over n rounds would differ by σ²/n. They differ by more where rounds share what they
    were filtered or reflected with; the ratio says how many rounds one independent round takes.
    """
    depth = 6
    sums, pairs = np.zeros(depth), np.zeros(depth)
    spreads: list[float] = []
    steps: list[float] = []
    for values, distance in zip(data.values, data.distance_m, strict=True):
        for column in np.flatnonzero(np.isfinite(distance)):
            good = np.isfinite(values[:, column])
            centred = np.where(good, values[:, column] - np.mean(values[good, column]), 0.0)
            spreads.append(float(centred @ centred) / (float(good.sum()) - 1.0))
            both = good[1:] & good[:-1]
            if both.any():
                steps.append(0.5 * float(np.mean(np.diff(centred)[both] ** 2)))
            for lag in range(min(depth, len(centred))):
                sums[lag] += float(centred[: len(centred) - lag] @ centred[lag:])
                pairs[lag] += float((good[: len(centred) - lag] & good[lag:]).sum())
    if not spreads or not steps or _usual(spreads) <= 0.0:
        return _Noise(SIGMA_FLOOR_M, 0.0, 0.0, np.array([1.0]))
    means = sums / np.maximum(pairs, 1.0)
    rounds = max(data.rounds, 1.0)
    sigma2 = max(_usual(spreads), SIGMA_FLOOR_M**2)
    adjacent = (np.diff(data.t_s) < 1.5 * data.length_s) & (np.diff(data.run) == 0)
    changes = np.diff(own, axis=0)[adjacent]
    between2 = (_scale(changes[np.isfinite(changes)]) ** 2) / 2.0
    worth = max(between2 * rounds / sigma2, 1.0)
    correlation = min((worth - 1.0) / (worth + 1.0), MOST_CORRELATED)
    sigma2 = max(sigma2, between2 * rounds * (1.0 - correlation) / (1.0 + correlation))
    explained = max(_usual(steps) / rounds, between2)
    return _Noise(float(np.sqrt(sigma2)), correlation, explained, means / means[0])


def _usual(variances: list[float]) -> float:
    """Mean of windows' variances without those of windows that something disturbed."""
    values = np.array(variances)
    return float(np.mean(values[values <= _DISTURBED * max(float(np.median(values)), 1e-12)]))


def _local(data: Windows, curves: Curves, own: Floats, noise2: float, overall: float, apart: float) -> Floats:
    """Each anchor's remaining bias at each knot: its nearest windows, and all anchors' as a prior."""
    anchors, knots = curves.bias_m.shape
    out = np.zeros((anchors, knots))
    for k, knot in enumerate(curves.knots_m):
        gaps = np.abs(data.distance_m - knot)
        pooled, pooled_count, _ = _near(own, gaps, NEIGHBOURS * anchors, overall)
        for a in range(anchors):
            mine, mine_count, reach = _near(own[:, [a]], gaps[:, [a]], NEIGHBOURS, overall)
            together = (mine_count * mine**2 + PRIOR_WINDOWS * pooled**2) / (mine_count + PRIOR_WINDOWS)
            excess = max(together - noise2, _LEAST_SHARE * together, BIAS_FLOOR_M**2)
            independent = (mine_count + min(pooled_count, PRIOR_WINDOWS)) / apart
            # Windows from further away than the knots' spacing say less about this one.
            away = SLOPE_M_PER_M * max(reach - _spacing(curves.knots_m, k), 0.0)
            spread2 = shrunk(excess, independent, PRIOR_OWN_M**2, PRIOR_SAMPLES)
            out[a, k] = wandered(np.sqrt(spread2), away)
    return out


def _near(values: Floats, gaps: Floats, count: int, overall: float) -> tuple[float, float, float]:
    """(scale, how many, how far away the first few are) of the ``count`` values nearest in distance."""
    good = np.isfinite(values) & np.isfinite(gaps)
    if not good.any():
        return overall, 0.0, np.inf if not np.isfinite(overall) else 0.0
    flat, near = values[good], gaps[good]
    order = np.argsort(near, kind="stable")[:count]
    return _scale(flat[order]), float(len(order)), float(near[order][:_CLOSEST][-1])


def _scale(values: Floats) -> float:
    """A standard deviation that outliers below 4.5 % do not move and heavy shoulders do: half the 95 % quantile."""
    if len(values) == 0:
        return 0.0
    return float(np.quantile(np.abs(values), _TWO_SIGMA)) / 2.0


def _centre(values: Floats) -> float:
    """Mean of the anchors that stand together; one that is obstructed has no say."""
    gaps = np.abs(values - np.median(values))
    return float(np.mean(values[gaps <= max(4.0 * float(np.median(gaps)), OBSTRUCTED_M)]))


def shrunk(variance: float, samples: float, known: float, worth: float) -> float:
    """A variance from some independent samples, drawn towards one that was known before, to state (Student).

    Drawn as a factor (the mean of logarithms), for that is how radios' spreads differ. Without any sample it is the one
    known: what was published is stated widely enough as it is.
    """
    share = samples / (samples + worth)
    together = float(known * (max(variance, BIAS_FLOOR_M**2) / known) ** share)
    return together * (1.0 + share * (inflation(samples + worth) - 1.0))


def wandered(sigma_m: float, away_m: float) -> float:
    """σ of a bias where nobody measured, which may have wandered ``away_m`` from where it was known to ``sigma_m``.

    No bias is known less than before anybody measured at all.
    """
    if away_m <= 0.0:
        return sigma_m
    unknown2 = PRIOR_OWN_M**2 + PRIOR_COMMON_M**2
    return float(max(sigma_m, np.sqrt(1.0 / (1.0 / (sigma_m**2 + away_m**2) + 1.0 / unknown2))))


def inflation(freedom: float) -> float:
    """How much larger than its estimate a variance has to be stated, so that a normal distribution covers as much."""
    return float((stdtrit(freedom, 0.5 + 0.5 * COVERED) / ndtri(0.5 + 0.5 * COVERED)) ** 2)


def _spacing(knots_m: Floats, index: int) -> float:
    if len(knots_m) < 2:
        return 1.0
    return float(knots_m[min(index + 1, len(knots_m) - 1)] - knots_m[max(index - 1, 0)]) / 2.0
