"""Between heights above mean sea level and above the WGS-84 ellipsoid, as far as that can be known.

The two lie up to 107 m apart (the geoid). By how much comes from a grid that an operator names, or is not said at all.
The grid is the one that NGA publishes for EGM96, WW15MGH.DAC: 721 rows from the north pole to the south pole, each of
1,440 values eastwards from Greenwich, in steps of 15′, big-endian 16-bit integers in centimetres. Between its points it
is good to about a metre.
"""

from __future__ import annotations

import array
import sys
from pathlib import Path
from typing import Final

ROWS: Final = 721
COLUMNS: Final = 1_440
STEP_E7: Final = 2_500_000
HIGHEST_CM: Final = 12_000
POLE_E7: Final = 900_000_000


class GeoidError(ValueError):
    """A file that is not the grid."""


class Geoid:
    """How far mean sea level lies above the ellipsoid."""

    def __init__(self, path: Path) -> None:
        """Raises `GeoidError` for a file that is not the grid."""
        try:
            content = path.read_bytes()
        except OSError as error:
            raise GeoidError(f"{path}: {error.strerror}") from None
        values = array.array("h")
        if len(content) != ROWS * COLUMNS * values.itemsize:
            raise GeoidError(f"{path} is not the EGM96 grid of 15' (WW15MGH.DAC)")
        values.frombytes(content)
        if sys.byteorder == "little":
            values.byteswap()
        if max(values) > HIGHEST_CM or min(values) < -HIGHEST_CM:
            raise GeoidError(f"{path} holds values that no geoid has")
        self._values = values

    def undulation_mm(self, lat_e7: int, lon_e7: int) -> int:
        """Height of mean sea level above the ellipsoid, between the grid's points by proportion. Never fails."""
        lat_e7 = max(-POLE_E7, min(lat_e7, POLE_E7))
        row, down = divmod(POLE_E7 - lat_e7, STEP_E7)
        column, along = divmod(lon_e7 % 3_600_000_000, STEP_E7)
        south, east = min(row + 1, ROWS - 1), (column + 1) % COLUMNS
        north_cm = self._between(row, column, east, along)
        south_cm = self._between(south, column, east, along)
        return round(10 * (north_cm + (south_cm - north_cm) * down / STEP_E7))

    def _between(self, row: int, west: int, east: int, along: int) -> float:
        left, right = self._values[row * COLUMNS + west], self._values[row * COLUMNS + east]
        return left + (right - left) * along / STEP_E7
