"""Running the lab: every attack at every level, in chunks over all cores, the same counts for the same seed."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from wonderland import __version__
from wonderland_research.attack_lab.attacks import ATTACKS
from wonderland_research.attack_lab.judge import Tally, run_batch
from wonderland_research.attack_lab.kept import KeptTallies
from wonderland_research.attack_lab.model import LEVELS, Attack, LabResult, result_of

CHUNK: Final = 1_000
"""Tries that one process takes at a time."""
SAMPLE: Final = 200
"""Tries of each attack and variant whose looks are all compared with the contract's decision."""
Progress = Callable[[str, int], None]
"""(attack, tries done) as they are done."""


@dataclass(frozen=True)
class LabSettings:
    """What to run. ``exact``: every look is the decision's own, nothing is screened (slow)."""

    attacks: tuple[str, ...] = ()
    levels: tuple[int, ...] = LEVELS
    tries: int = 1_000
    seed: int = 1
    exact: bool = False
    processes: int = 0
    """0: as many as there are cores."""
    sample: int = SAMPLE
    keep: Path | None = None
    """Where chunks are kept as they are played, and taken from by a later run."""


@dataclass(frozen=True)
class _Chunk:
    attack: str
    variant: int
    number: int
    tries: int
    sample: int
    seed: int
    exact: bool

    @property
    def name(self) -> str:
        """For its file: all that its counts depend on."""
        exact = "-exact" if self.exact else ""
        return f"{self.attack}-{self.variant}-{self.number}-{self.tries}-{self.seed}{exact}"


class UnknownAttackError(Exception):
    """A name that is no attack's; the text lists those that there are."""


def chosen(names: Sequence[str]) -> list[Attack]:
    """These attacks, or all. Raises UnknownAttackError."""
    unknown = [name for name in names if name not in ATTACKS]
    if unknown:
        raise UnknownAttackError(
            f"no attack is called {', '.join(unknown)}; wonderland attack --list says what there is"
        )
    return [ATTACKS[name] for name in names] if names else list(ATTACKS.values())


def run(settings: LabSettings, progress: Progress = lambda *_: None) -> LabResult:
    """Play all tries; raises UnknownAttackError, and LabError where screen and decision differ."""
    started = time.monotonic()
    attacks = chosen(settings.attacks)
    tallies: dict[tuple[str, int], Tally] = {}
    for chunk, tally in _resumed(settings, _chunks(settings, attacks)):
        tallies.setdefault((chunk.attack, chunk.variant), Tally()).add(tally)
        progress(chunk.attack, chunk.tries)
    results = []
    for attack in attacks:
        levels = [
            (level, tallies[attack.name, number])
            for number, variant in enumerate(attack.variants)
            for level in variant.levels
            if (attack.name, number) in tallies and level in settings.levels
        ]
        results.append(result_of(attack, sorted(levels, key=lambda pair: pair[0])))
    return LabResult(
        seed=settings.seed,
        tries=settings.tries,
        took_s=time.monotonic() - started,
        versions={
            "wonderland": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        attacks=tuple(results),
    )


def total_tries(settings: LabSettings) -> dict[str, int]:
    """How many tries each attack will take, all its variants together."""
    counts: dict[str, int] = {}
    for chunk in _chunks(settings, chosen(settings.attacks)):
        counts[chunk.attack] = counts.get(chunk.attack, 0) + chunk.tries
    return counts


def _chunks(settings: LabSettings, attacks: Sequence[Attack]) -> list[_Chunk]:
    chunks = []
    for attack in attacks:
        for number, variant in enumerate(attack.variants):
            if not set(variant.levels) & set(settings.levels):
                continue
            left = tries = max(1, settings.tries // variant.dear)
            for count in range(0, tries, CHUNK):
                size = min(CHUNK, left)
                part = min(size, max(1, settings.sample * CHUNK // tries))
                chunks.append(_Chunk(attack.name, number, count // CHUNK, size, part, settings.seed, settings.exact))
                left -= size
    return chunks


def _resumed(settings: LabSettings, chunks: Sequence[_Chunk]) -> Iterator[tuple[_Chunk, Tally]]:
    """All chunks: those that were kept, then the others as they are played."""
    kept = KeptTallies(settings.keep)
    left = []
    for chunk in chunks:
        tally = kept.find_tally(chunk.name)
        if tally is None:
            left.append(chunk)
        else:
            yield chunk, tally
    for chunk, tally in _played(left, settings.processes or os.cpu_count() or 1):
        kept.keep(chunk.name, tally)
        yield chunk, tally


def _played(chunks: Sequence[_Chunk], processes: int) -> Iterator[tuple[_Chunk, Tally]]:
    if processes == 1 or len(chunks) == 1:
        for chunk in chunks:
            yield chunk, _play(chunk)
        return
    # A fresh interpreter for each: a fork would copy whatever threads the caller runs.
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_one_thread) as pool:
        waiting: dict[Future[Tally], _Chunk] = {}
        ahead = iter(chunks)
        try:
            while True:
                for fresh in islice(ahead, 2 * processes - len(waiting)):
                    waiting[pool.submit(_play, fresh)] = fresh
                if not waiting:
                    return
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    yield waiting.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _one_thread() -> None:
    """Each process uses one core; the arrays are too small for more."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


def _play(chunk: _Chunk) -> Tally:
    attack = ATTACKS[chunk.attack]
    variant = attack.variants[chunk.variant]
    name = int.from_bytes(attack.name.encode(), "big")  # independent of which other attacks run
    rng = np.random.default_rng((chunk.seed, name, chunk.variant, chunk.number))
    if variant.play is not None:
        return variant.play(rng, chunk.tries)
    assert variant.make is not None
    return run_batch(variant.make(rng, chunk.tries), sample=chunk.sample, screened=not chunk.exact)
