"""Where commands print for people: what is piped is as wide as it wants to be, and nothing is cut off there."""

from __future__ import annotations

from typing import Final

from rich.console import Console

_PIPED_COLUMNS: Final = 10_000


def for_people(*, stderr: bool = False) -> Console:
    """Standard output, or standard error; without guesses at what might be highlighted."""
    found = Console(stderr=stderr, highlight=False)
    # Rich takes 80 columns where there is no terminal, and cuts tables there.
    return found if found.is_terminal else Console(stderr=stderr, highlight=False, width=_PIPED_COLUMNS)
