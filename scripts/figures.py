"""Draw the pictures of docs/method*.md with the verdict's own functions: ``make figures``."""

from __future__ import annotations

import sys
from pathlib import Path

from wonderland_research.reproduction.method_figures import draw_all

IMAGES = Path(__file__).parent.parent / "docs" / "images"


def main() -> int:
    """Draw all of them; the exit code."""
    for path in draw_all(IMAGES):
        print(path.relative_to(IMAGES.parent.parent))
    return 0


if __name__ == "__main__":
    sys.exit(main())
