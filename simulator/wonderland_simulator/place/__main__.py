"""``python -m wonderland_simulator.place``: make the archive of the demo's place, unless it is there."""

from __future__ import annotations

import os
import sys

from wonderland_simulator.place.making import PlaceError, make


def main() -> int:
    """One line on standard error where it cannot be made."""
    os.nice(10)
    try:
        make()
    except PlaceError as error:
        print(error, file=sys.stderr)  # noqa: T201 - what the demo passes on
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
