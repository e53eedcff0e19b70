"""Wonderland: the shared library. Each part stands alone; see ``docs/architecture.md``."""

from typing import Final

__version__: Final = "0.1.0"
