"""Chunks of a run that were played before: a run of hours can be ended, and goes on where it was."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from functools import cache
from hashlib import sha256
from pathlib import Path

import wonderland.proofs
from wonderland_research.attack_lab.judge import LabError, Tally


@cache
def code() -> str:
    """Digest of the decision's sources and of the lab's: a tally holds for these and no others."""
    found = sha256()
    for package in (Path(wonderland.proofs.__file__).parent, Path(__file__).parent):
        for path in sorted(package.rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()


class KeptTallies:
    """A directory with one JSON file for each chunk, by its name; None keeps nothing.

    What other code played (``code``) is not taken.
    """

    def __init__(self, directory: Path | None) -> None:
        """Raises LabError where the directory cannot be made."""
        self._directory = directory
        if directory is not None:
            try:
                directory.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise LabError(f"{directory}: cannot keep what is played there ({error.strerror})") from error

    def find_tally(self, name: str) -> Tally | None:
        """What a chunk came to; None where it is not there, or of other code. Raises LabError for another file."""
        if self._directory is None:
            return None
        path = self._directory / f"{name}.json"
        try:
            value = json.loads(path.read_text(encoding="utf-8"))
            if value.pop("code") != code():
                return None
            if set(value) != {field.name for field in fields(Tally)}:
                raise LabError(f"{path}: no tally; remove it")
            return Tally(**value)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise LabError(f"{path}: no tally; remove it ({error})") from error

    def keep(self, name: str, tally: Tally) -> None:
        """Keep a chunk; a half-written one is never seen. Raises LabError."""
        if self._directory is None:
            return
        path = self._directory / f"{name}.json"
        part = path.with_suffix(".part")
        try:
            part.write_text(json.dumps({"code": code(), **asdict(tally)}), encoding="utf-8")
            part.replace(path)
        except OSError as error:
            raise LabError(f"{path}: cannot be written ({error.strerror})") from error
