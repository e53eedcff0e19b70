"""What the generators of reference pages share: Markdown, and where it is written."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Its lines. A bar within a cell is no border."""
    lines = (" | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in row) for row in rows)
    return [
        f"|{'|'.join(f' {head} ' if head else ' ' for head in heads)}|",
        "|---" * len(heads) + "|",
        *(f"| {line} |" for line in lines),
    ]


def prose(text: str) -> str:
    """A text of the code as one line of Markdown: <name> is no HTML, a star is a star, ``code`` is `code`."""
    parts = " ".join(text.replace("``", "`").split()).split("`")
    for index in range(0, len(parts), 2):
        part = re.sub(r"(?<=\w)'(?=\w)|(?<=s)'(?= )", "’", parts[index])
        parts[index] = part.replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")
    return "`".join(parts)


def write(page: Callable[[], str]) -> None:
    """Write it to the file that the command's argument names."""
    to = Path(sys.argv[1])
    to.parent.mkdir(parents=True, exist_ok=True)
    to.write_text(page(), encoding="utf-8")
