"""A geoid's grid in the format of NGA's, with values that a test can work out."""

from __future__ import annotations

import array
import sys

from wonderland.geoid import COLUMNS, ROWS


def write_geoid(path):
    """Rises by 1 m for each degree to the north pole, and lies 3 m higher at the Greenwich meridian. The path."""
    values = array.array(
        "h",
        [
            round((90 - row * 0.25) * 100) + (300 if column == 0 else 0)
            for row in range(ROWS)
            for column in range(COLUMNS)
        ],
    )
    if sys.byteorder == "little":
        values.byteswap()
    path.write_bytes(values.tobytes())
    return path
