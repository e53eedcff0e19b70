"""What an attack is, and what the lab reports of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any, Final

import numpy as np
from scipy import stats

from wonderland_research.attack_lab.batch import Batch
from wonderland_research.attack_lab.judge import Tally, seconds

LEVELS: Final = (0, 1, 2, 3, 4)
CONFIDENCE: Final = 0.95

Make = Callable[[np.random.Generator, int], Batch]
"""(random numbers, tries) → these tries."""
Play = Callable[[np.random.Generator, int], Tally]
"""The same for attacks on the protocol: what became of these tries."""


class Family(StrEnum):
    """By what the attacker works on."""

    BASELINE = "baseline"
    GNSS = "position"
    CLAIM = "claim"
    OUTSIDER = "outsider"
    RADIO = "radio"
    INSIDER = "insider"
    PAD = "pad"
    PROTOCOL = "protocol"
    COLLUSION = "collusion"


@dataclass(frozen=True)
class Variant:
    """One simulation of an attack; it stands for all ``levels`` at which the attack goes the same way."""

    levels: tuple[int, ...]
    make: Make | None = None
    play: Play | None = None
    dear: int = 1
    """Only every so manieth of the tries asked for is played: each costs much more than elsewhere."""


@dataclass(frozen=True)
class Attack:
    """One documented class of attack."""

    name: str
    family: Family
    title: str
    controls: str
    """What the attacker has in hand."""
    cost: str
    """What that costs."""
    wins: str
    """What counts as the attacker's success."""
    stops: str
    """What stops it, or why nothing does."""
    stopped_from: int | None
    """Lowest assurance from which on it wins nothing; None where no level stops it."""
    variants: tuple[Variant, ...]
    tolerated: float = 0.0
    """Share of permissions that the policy's error limit lets through where it is stopped."""
    wire: str = ""
    """How the sample through the real agents and ledger is done (``wonderland_research.attack_lab.wire``)."""

    @property
    def levels(self) -> tuple[int, ...]:
        """At which it was simulated."""
        return tuple(sorted({level for variant in self.variants for level in variant.levels}))

    def described(self) -> AttackResult:
        """What is known of it without playing it."""
        return AttackResult(
            self.name,
            str(self.family),
            self.title,
            self.controls,
            self.cost,
            self.wins,
            self.stops,
            self.stopped_from,
            (),
        )

    def stopped_at(self, level: int) -> bool:
        """Whether it is documented to win nothing there."""
        return self.stopped_from is not None and level >= self.stopped_from


@dataclass(frozen=True)
class LevelResult:
    """One attack at one level of assurance."""

    level: int
    tries: int
    won: int
    won_low: float
    won_high: float
    granted: int
    refuted: int
    open: int
    refused: int
    """Not even taken, by the contract or by the link."""
    detected_s_median: float | None
    """Seconds of ranging until it was refuted, of the tries that were."""
    detected_s_95: float | None
    error_refuted_m_most: float | None
    """Farthest from its claim that a drone was when it was refuted."""
    error_won_m_most: float | None
    """Farthest from its claim that a drone was with a permission it should not have."""
    sampled: int
    decisions: int
    as_documented: bool
    """Whether what was measured is what the class's description says of this level."""
    granted_beyond: int = 0
    """Permissions of drones more than a buffer from their claims, the attacker's success or not."""
    error_granted_m_most: float | None = None
    """The farthest of them."""

    @property
    def interval(self) -> str:
        """Permissions won as a share, with its interval."""
        return f"{share(self.won, self.tries)} ({percent(self.won_low)}–{percent(self.won_high)})"


@dataclass(frozen=True)
class AttackResult:
    """One attack at all its levels."""

    name: str
    family: str
    title: str
    controls: str
    cost: str
    wins: str
    stops: str
    stopped_from: int | None
    levels: tuple[LevelResult, ...]


@dataclass(frozen=True)
class LabResult:
    """A run of the lab: enough to repeat it and to print it."""

    seed: int
    tries: int
    took_s: float
    versions: dict[str, str]
    attacks: tuple[AttackResult, ...] = field(default=())

    @property
    def as_documented(self) -> bool:
        """Whether every class came out as its description says."""
        return all(level.as_documented for attack in self.attacks for level in attack.levels)

    def to_json(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return asdict(self)


def result_of(attack: Attack, tallies: Sequence[tuple[int, Tally]]) -> AttackResult:
    """Counts with their intervals."""
    return replace(attack.described(), levels=tuple(_level(attack, level, tally) for level, tally in tallies))


def _level(attack: Attack, level: int, tally: Tally) -> LevelResult:
    low, high = interval(tally.won, tally.tries)
    rounds = tally.detected_rounds
    stopped = attack.stopped_at(level)
    # A documented success has to be seen, a documented failure must not; an error limit is judged by its interval.
    documented = low <= attack.tolerated if stopped else tally.won > 0
    if stopped and attack.tolerated == 0.0:
        documented = tally.won == 0
    return LevelResult(
        level=level,
        tries=tally.tries,
        won=tally.won,
        won_low=low,
        won_high=high,
        granted=tally.granted,
        refuted=tally.refuted,
        open=tally.open,
        refused=tally.refused,
        detected_s_median=seconds(float(np.median(rounds))) if rounds else None,
        detected_s_95=seconds(float(np.quantile(rounds, 0.95))) if rounds else None,
        error_refuted_m_most=max(tally.error_refuted_mm) / 1000.0 if tally.error_refuted_mm else None,
        error_won_m_most=max(tally.error_won_mm) / 1000.0 if tally.error_won_mm else None,
        sampled=tally.sampled,
        decisions=tally.decisions,
        as_documented=documented,
        granted_beyond=len(tally.error_granted_mm),
        error_granted_m_most=max(tally.error_granted_mm) / 1000.0 if tally.error_granted_mm else None,
    )


@lru_cache(maxsize=4096)
def interval(count: int, tries: int) -> tuple[float, float]:
    """95 % confidence interval of a share (Clopper and Pearson)."""
    if not tries:
        return 0.0, 1.0
    found = stats.binomtest(count, tries).proportion_ci(confidence_level=CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


def share(count: int, tries: int) -> str:
    """Exactly 0 and 100 % are said as such: rounding shall hide no success."""
    if not tries:
        return "–"
    if count in {0, tries}:
        return "0" if not count else "100 %"
    return percent(count / tries)


def percent(value: float) -> str:
    """Two significant figures below 10 %, whole per cent only where nothing is lost by it."""
    if value in {0.0, 1.0}:
        return f"{value * 100:.0f} %"
    if value > 0.9995:
        return f"{value * 100:.3f} %"
    return f"{value * 100:.2g} %" if value < 0.1 else f"{value * 100:.1f} %"
