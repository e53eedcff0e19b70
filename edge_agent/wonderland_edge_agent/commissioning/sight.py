"""In line of sight or not: which seconds of an anchor's ranges something stood in the way of.

A mixture for each anchor: what was seen directly scatters about the curve by its σ; what went through or around
something may be off by up to a metre, nearly always too long. Where the radio tells how much weaker the first path is
than all that it received, that counts as well, but only so much: it is weak evidence.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wonderland_edge_agent.commissioning.run import Floats

OFF_M: Final = 1.0
"""Obstructed ranges are off by up to this, any value as likely as another."""
TOO_LONG: Final = 0.9
"""Share of them that are too long."""
EXPECTED: Final = 0.03
"""Share of seconds that are obstructed, before anything was seen; it counts as much as ``EXPECTED_SECONDS``."""
EXPECTED_SECONDS: Final = 20.0
MOST: Final = 0.6
"""Were more of an anchor's seconds obstructed, nobody could tell which they are."""
SCALE_FLOOR_M: Final = 0.005
FIRST_PATH_DB: Final = 6.0
"""By how much weaker an obstructed first path is than that anchor's usual one, about; and how much that varies."""
FIRST_PATH_SIGMA_DB: Final = 4.0
LEAST_SPREAD_DB: Final = 1.5
MOST_ODDS: Final = 10.0
"""More than this the first path alone never says."""
_STEPS: Final = 25


def in_sight(rest_m: Floats, first_path_db: Floats | None = None) -> Floats:
    """Probability of each second of one anchor to be in line of sight; 1 where there is no range (NaN).

    ``rest_m`` (w,): errors about the anchor's curve.
    """
    out = np.ones(len(rest_m))
    good = np.isfinite(rest_m)
    rest = rest_m[good]
    if len(rest) < 3:
        return out
    odds = _first_path_odds(None if first_path_db is None else first_path_db[good], len(rest))
    away = np.where(rest > 0, TOO_LONG, 1.0 - TOO_LONG) / OFF_M * odds
    scale = max(1.4826 * float(np.median(np.abs(rest))), SCALE_FLOOR_M)
    share = EXPECTED
    clear = np.ones(len(rest))
    for _ in range(_STEPS):
        seen = (1.0 - share) * np.exp(-0.5 * (rest / scale) ** 2) / (scale * np.sqrt(2.0 * np.pi))
        clear = seen / np.maximum(seen + share * away, 1e-300)
        scale = max(float(np.sqrt((clear @ rest**2) / max(float(clear.sum()), 1.0))), SCALE_FLOOR_M)
        share = (float((1.0 - clear).sum()) + EXPECTED * EXPECTED_SECONDS) / (len(rest) + EXPECTED_SECONDS)
        share = min(share, MOST)
    out[good] = clear
    return out


def all_in_sight(rest_m: Floats, first_path_db: Floats | None) -> Floats:
    """``in_sight`` of every anchor (w, a)."""
    columns = [
        in_sight(rest_m[:, index], None if first_path_db is None else first_path_db[:, index])
        for index in range(rest_m.shape[1])
    ]
    return np.stack(columns, axis=1)


def _first_path_odds(first_path_db: Floats | None, count: int) -> Floats:
    """How much more usual such a first path is where something stood between."""
    if first_path_db is None or not np.isfinite(first_path_db).any():
        return np.ones(count)
    usual = float(np.nanmedian(first_path_db))
    spread = max(1.4826 * float(np.nanmedian(np.abs(first_path_db - usual))), LEAST_SPREAD_DB)
    wide = float(np.hypot(spread, FIRST_PATH_SIGMA_DB))
    high = np.maximum(first_path_db - usual, 0.0)
    odds = np.exp(0.5 * (high / spread) ** 2 - 0.5 * ((high - FIRST_PATH_DB) / wide) ** 2) * spread / wide
    return np.asarray(np.clip(np.where(np.isfinite(odds), odds, 1.0), 1.0 / MOST_ODDS, MOST_ODDS))
