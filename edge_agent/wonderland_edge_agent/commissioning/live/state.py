"""The directory of a commissioning: what each step found, as files that the next one, or the next day, goes on from."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Final

from wonderland_edge_agent.commissioning.errors import StateError
from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_fabric_gateway.files import PRIVATE, write_atomic

STEPS: Final = ("survey", "check", "run", "fit", "publish")
VERSION: Final = 1
MAX_FILE_BYTES: Final = 16 << 20


class StateDirectory:
    """Files of one commissioning of one pad. Raises StateError when it is another pad's or cannot be used."""

    def __init__(self, path: Path, pad_id: str) -> None:
        self.path: Final = path
        try:
            path.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise StateError(f"{path}: cannot be made ({error.strerror or error})") from error
        about = self.read("about")
        if about is None:
            self.write("about", {"version": VERSION, "pad_id": pad_id})
        elif about.get("version") != VERSION or about.get("pad_id") != pad_id:
            raise StateError(
                f"{path}: holds a commissioning of pad {about.get('pad_id')!r} (version {about.get('version')}); give "
                "another directory"
            )

    def read(self, name: str) -> dict[str, Any] | None:
        """What a step found; None where it has not been done. Raises StateError."""
        path = self.path / f"{name}.json"
        try:
            with path.open("rb") as file:
                value = json.loads(file.read(MAX_FILE_BYTES))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            raise StateError(f"{path}: cannot be read ({error}); remove it to do that step again") from error
        if not isinstance(value, dict):
            raise StateError(f"{path}: holds no step; remove it to do that step again")
        return value

    def write(self, name: str, value: dict[str, Any]) -> None:
        """Keep what a step found, durably. Raises StateError."""
        try:
            write_atomic(self.path / f"{name}.json", json.dumps(value, indent=1).encode() + b"\n", PRIVATE)
        except FileWriteError as error:
            raise StateError(str(error)) from error

    def forget_from(self, step: str) -> None:
        """Do this step and all after it again; recorded runs stay, unless the run itself is to be done again."""
        for name in STEPS[STEPS.index(step) :]:
            (self.path / f"{name}.json").unlink(missing_ok=True)
        if STEPS.index(step) <= STEPS.index("run"):
            for path in [*self.runs(), *self.references(), *sorted(self.path.glob("stamps-*.csv"))]:
                path.replace(path.with_suffix(".csv.old"))

    def runs(self) -> list[Path]:
        """Recorded runs, in order."""
        return sorted(self.path.glob("run-*.csv"))

    def references(self) -> list[Path]:
        """Recorded references, in order."""
        return sorted(self.path.glob("reference-*.csv"))

    def next_run(self) -> tuple[Path, Path]:
        """Files for one more run and its reference."""
        number = len(self.runs()) + 1
        return self.path / f"run-{number}.csv", self.path / f"reference-{number}.csv"


def time_stamps_of(run: Path) -> Path:
    """The file of a run's time stamps, whether there are any or not."""
    return run.with_name(run.name.replace("run-", "stamps-"))


def fingerprint(value: Any) -> str:
    """Whether a later step still rests on the same earlier one."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]
