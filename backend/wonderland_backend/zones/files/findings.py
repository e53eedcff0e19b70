"""What is wrong with a file of zones, or was repaired: where, what, and what to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from wonderland_backend.zones.files.lines import Lines, Path, path_text

MAX_LISTED: Final = 200
"""So many errors, and as many notices, are listed; further ones are counted."""


@dataclass(frozen=True, order=True)
class Finding:
    """One error or notice."""

    line: int
    column: int
    path: str
    message: str


@dataclass
class Findings:
    """Collected while a file is read."""

    errors: list[tuple[Path, str]] = field(default_factory=list)
    notices: list[tuple[Path, str]] = field(default_factory=list)
    error_count: int = 0
    notice_count: int = 0

    def error(self, path: Path, message: str) -> None:
        """Something that keeps the file out."""
        self.error_count += 1
        if len(self.errors) < MAX_LISTED:
            self.errors.append((path, message))

    def notice(self, path: Path, message: str) -> None:
        """Something that was understood all the same, or repaired."""
        self.notice_count += 1
        if len(self.notices) < MAX_LISTED:
            self.notices.append((path, message))


def placed(found: list[tuple[Path, str]], lines: Lines) -> list[Finding]:
    """With their lines, in the order of the file."""
    return sorted(Finding(*lines.of(path), path_text(path), message) for path, message in found)
