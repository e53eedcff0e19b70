"""Runs ProVerif, which is built beside the project, and reads what it found."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from wonderland_research.protocol.model import DIRECTORY, Lemma, Scenario

VARIABLE: Final = "PROVERIF_BIN"
LONGEST_S: Final = 900
Outcome = Literal["holds", "attack", "not proved", "reached", "never reached"]
_RESULT: Final = re.compile(r"^RESULT (?!\().* (is true|is false|cannot be proved)\.$", re.MULTILINE)


class ProverError(Exception):
    """ProVerif is not there, or did not do what it should; the text says what to do."""


@dataclass(frozen=True, slots=True)
class Run:
    """One scenario at one level (None: levels have no part in it), with ProVerif's own words, attacks step by step."""

    scenario: Scenario
    level: int | None
    outcomes: dict[str, Outcome]
    output: str


def binary() -> Path:
    """ProVerif's program. Raises ProverError."""
    named = os.environ.get(VARIABLE)
    if not named:
        raise ProverError(f"{VARIABLE} names no program: build ProVerif 2.05 and set it (docs/protocol.md)")
    path = Path(named)
    if not os.access(path, os.X_OK) or path.is_dir():
        raise ProverError(f"{VARIABLE}: {path} is no program")
    return path


def prove(program: Path, scenario: Scenario, level: int | None, *, directory: Path = DIRECTORY) -> Run:
    """Ask all of a scenario's lemmas at a level. Raises ProverError."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / f"{scenario.name}.pv"
        path.write_text(scenario.source, encoding="utf-8")
        command = [str(program)]
        for library in scenario.libraries(level):
            command += ["-lib", str(directory / library)]
        try:
            done = subprocess.run(  # noqa: S603 - the program that the user named, with files of ours
                [*command, str(path)], capture_output=True, text=True, timeout=LONGEST_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as cause:
            raise ProverError(f"{scenario.name} at level {level}: {cause}") from cause
    found = _RESULT.findall(done.stdout)
    if done.returncode or len(found) != len(scenario.lemmas):
        last = (done.stdout + done.stderr).strip()[-500:]
        raise ProverError(f"{scenario.name} at level {level}: {len(found)} of {len(scenario.lemmas)} answers\n{last}")
    outcomes = {lemma.name: _outcome(lemma, said) for lemma, said in zip(scenario.lemmas, found, strict=True)}
    return Run(scenario, level, outcomes, done.stdout)


def prove_all(
    program: Path,
    asked: Iterable[tuple[Scenario, int | None]],
    heard: Callable[[Run], None] = lambda _run: None,
    *,
    processes: int | None = None,
) -> list[Run]:
    """Several at once, as many as there are cores. Raises ProverError."""
    with ThreadPoolExecutor(processes or os.cpu_count()) as pool:
        under_way = [pool.submit(prove, program, scenario, level) for scenario, level in asked]
        try:
            for each in as_completed(under_way):
                heard(each.result())
        finally:
            for each in under_way:
                each.cancel()
    return [each.result() for each in under_way]


def _outcome(lemma: Lemma, said: str) -> Outcome:
    if said == "cannot be proved":
        return "not proved"
    if lemma.reaches:  # the query says that it never happens
        return "reached" if said == "is false" else "never reached"
    return "holds" if said == "is true" else "attack"
