"""Many fixes at once with NumPy: ``wonderland.proofs.fix`` for whole recordings and Monte-Carlo samples."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.fix import Multilateration

Array = NDArray[np.float64]
_STEPS: Final = 2
_SHORT_STEP: Final = 4e-4


def fixes(anchors: Array, ranges: Array, up: float | Array) -> Array:
    """East and north of each row of ranges; shapes (n, 3) and (k, n), ``up`` (k,) or one number → (k, 2). One unit.

    A row with a range that is missing (NaN) gives NaN. Raises GeometryError for anchors in a line or fewer than three.
    The formulas are those of ``Multilateration``; matrix products take the place of its loops.
    """
    ranges = np.asarray(ranges, dtype=float)
    if ranges.ndim != 2 or ranges.shape[1] != len(anchors):
        raise GeometryError(
            f"ranges of shape {ranges.shape} do not belong to {len(anchors)} anchors: (k, n) is expected"
        )
    Multilateration([(float(east), float(north), float(height)) for east, north, height in anchors])  # or it refuses
    middle = anchors[:, :2].mean(axis=0)
    arms = anchors[:, :2] - middle
    x, y = arms[:, :1], arms[:, 1:]
    # Columns are rounds: each operation then runs along memory.
    measured = np.ascontiguousarray(ranges.T)
    rise = (np.asarray(up, dtype=float) - anchors[:, 2:]) ** 2
    spread = (arms**2).sum(axis=1, keepdims=True)
    horizontal = measured * measured - rise
    east, north = -0.5 * np.linalg.pinv(arms) @ (horizontal - spread)
    square = horizontal.mean(axis=0) - spread.mean()
    length = east * east + north * north
    usable = (square > 0.0) & (length > 0.0)
    scale = np.sqrt(np.divide(square, length, out=np.ones_like(square), where=usable))
    east, north = scale * east, scale * north
    east, north, step = _step(x, y, rise, measured, east, north)
    for _ in range(_STEPS - 1):
        again = np.flatnonzero(step > _SHORT_STEP * (east * east + north * north))
        if not again.size:
            break
        here = rise if rise.shape[1] == 1 else rise[:, again]
        east[again], north[again], step[again] = _step(x, y, here, measured[:, again], east[again], north[again])
    return np.column_stack([east + middle[0], north + middle[1]])


def _step(x: Array, y: Array, rise: Array, measured: Array, east: Array, north: Array) -> tuple[Any, Any, Any]:
    """One Gauss–Newton step: the new place, and the square of the step."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ue, un = east - x, north - y
        away = np.sqrt(ue * ue + un * un + rise)
        ue /= away
        un /= away
        residual = measured - away
        ee, en, nn = (ue * ue).sum(axis=0), (ue * un).sum(axis=0), (un * un).sum(axis=0)
        be, bn = (ue * residual).sum(axis=0), (un * residual).sum(axis=0)
        determinant = ee * nn - en * en
        step_east = (nn * be - en * bn) / determinant
        step_north = (ee * bn - en * be) / determinant
    return east + step_east, north + step_north, step_east * step_east + step_north * step_north
