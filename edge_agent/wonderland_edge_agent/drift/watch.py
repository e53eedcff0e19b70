"""Sequential change detection on ranges between anchors: each look alone is weak evidence, many together are not.

Two-sided CUSUM for each pair: sums of (z ∓ k), kept at 0 from below, alarm at h, where z is how far a measurement lies
from the baseline in standard deviations. With k = 1 a shift of 2σ and more is found fastest. The mean number of looks
to a false alarm of one side is (e^{2kb} − 2kb − 1)/(2k²), b = h + 1.166 (Siegmund); h is chosen from it, so that all
pairs and both sides together raise a false alarm once in ten years on average.

What all pairs share (temperature, antennas drenched by rain) is watched as one more series with a wider σ, and taken
out of the others. Which anchor moved, how far and how certainly, ``self_survey`` says. An anchor that moves without
changing its distance to the others, as straight up on a flat pad, cannot be seen this way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from wonderland.telemetry import Drift
from wonderland.telemetry.fields import DriftCondition
from wonderland_edge_agent.drift.baseline import Baseline, PairBaseline, median
from wonderland_edge_agent.self_survey import Priors, SelfSurvey, self_survey

SLACK: Final = 1.0
FALSE_ALARM_YEARS: Final = 10.0
YEAR_S: Final = 365.25 * 86_400
BASELINE_SIGMAS: Final = 3.0
FLOOR_MM: Final = 8.0
"""What a pair's range wanders from day to day without anything having happened (1σ)."""
COMMON_MM: Final = 25.0
"""The same for what all pairs share: 2 mm/°C over a year's temperatures."""
MIN_PAIRS: Final = 2
MOVED_MM: Final = 30.0
"""Less than this is called drift, not a moved anchor."""
RECOVERY_LOOKS: Final = 3
"""So many good looks end an alarm, where what caused it is over."""
LEAST_MM: Final = 10
MOST_MM: Final = 10_000
_OVERSHOOT: Final = 1.166
_MOST: Final = 50.0

Pair = tuple[str, str]
Places = Mapping[str, tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class DriftState:
    """What the pad knows about itself. ``state``: ok; drifting (something changed); moved (an anchor is elsewhere)."""

    state: DriftCondition
    checked_ms: int
    looks: int
    anchor_id: str = ""
    """The anchor that explains it best."""
    off_mm: int = 0
    sigma_mm: int = 0
    common_mm: int = 0
    """Change that all pairs share."""
    since_ms: int = 0
    exchanged_with: str = ""
    """The anchor that stands where this one should, and the other way round."""

    @property
    def extra_sigma_mm(self) -> int:
        """Uncertainty of each range that the change adds; 0 while all is well."""
        if self.state == "ok":
            return 0
        return min(max(abs(self.common_mm), round(math.hypot(self.off_mm, self.sigma_mm)), LEAST_MM), MOST_MM)

    def health(self) -> Drift:
        """Part ``drift`` of a health record."""
        if self.state == "ok":
            return Drift(state=self.state, checked_ms=self.checked_ms, looks=self.looks)
        return Drift(
            state=self.state,
            checked_ms=self.checked_ms,
            looks=self.looks,
            since_ms=self.since_ms,
            common_mm=self.common_mm,
            extra_sigma_mm=self.extra_sigma_mm,
            anchor_id=self.anchor_id or None,
            off_mm=self.off_mm if self.anchor_id else None,
            sigma_mm=self.sigma_mm if self.anchor_id else None,
        )


@dataclass(slots=True)
class Cusum:
    """Two one-sided sums of one series of standardised values."""

    threshold: float
    up: float = 0.0
    down: float = 0.0

    def add(self, z: float, slack: float = SLACK) -> bool:
        """Take a value; whether the alarm is raised."""
        most = self.threshold + RECOVERY_LOOKS * SLACK
        self.up = min(max(0.0, self.up + z - slack), most)
        self.down = min(max(0.0, self.down - z - slack), most)
        return self.alarmed

    @property
    def alarmed(self) -> bool:
        """Whether either sum is at its threshold."""
        return max(self.up, self.down) >= self.threshold


def threshold(series: int, interval_s: float, years: float = FALSE_ALARM_YEARS) -> float:
    """CUSUM limit h at which ``series`` two-sided sums raise one false alarm in ``years`` on average."""
    wanted = 2 * series * years * YEAR_S / interval_s
    low, high = 0.0, _MOST / 2
    for _ in range(60):
        middle = (low + high) / 2
        b = 2 * SLACK * (middle + _OVERSHOOT)
        if (math.exp(b) - b - 1) / (2 * SLACK**2) < wanted:
            low = middle
        else:
            high = middle
    return high


@dataclass(slots=True)
class DriftWatch:
    """All pairs of a pad. ``places_m``: anchors as commissioned; ``interval_s``: between looks."""

    baseline: Baseline
    places_m: Places
    interval_s: float
    looks: int = 0
    _sums: dict[Pair, Cusum] = field(default_factory=dict)
    _common: Cusum = field(init=False)
    _limit: float = field(init=False)
    _state: DriftState = field(init=False)
    _recent: dict[Pair, PairBaseline] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._limit = threshold(len(self.baseline.pairs) + 1, self.interval_s)
        self._sums = {pair: Cusum(self._limit) for pair in self.baseline.pairs}
        self._common = Cusum(self._limit)
        self._state = DriftState("ok", self.baseline.t_ms, 0)

    @property
    def state(self) -> DriftState:
        """After the last look."""
        return self._state

    def judge_pairs(self, t_ms: int, measured: Mapping[Pair, PairBaseline]) -> DriftState:
        """Take one measurement of the pairs (``baseline.summary``); pairs may be missing."""
        known = {pair: value for pair, value in measured.items() if pair in self.baseline.pairs}
        if len(known) < MIN_PAIRS:
            return self._state
        self.looks += 1
        changes = {pair: value.range_mm - self.baseline.pairs[pair].range_mm for pair, value in known.items()}
        common = median(changes.values())
        noise = {pair: math.hypot(value.sigma_mm, self.baseline.pairs[pair].sigma_mm) for pair, value in known.items()}
        self._common.add(common / math.hypot(COMMON_MM, median(noise.values())))
        for pair, change in changes.items():
            # An anchor that moved also moves the median that is taken out: neither with nor without it alone will do.
            rest = min(change - common, change, key=abs) if abs(common) < COMMON_MM else change - common
            scale = math.hypot(FLOOR_MM, noise[pair])
            # The baseline's own error is the same in every look: it must not add up.
            self._sums[pair].add(rest / scale, SLACK + BASELINE_SIGMAS * self.baseline.pairs[pair].sigma_mm / scale)
        self._recent |= known
        alarmed = self._common.alarmed or any(item.alarmed for item in self._sums.values())
        self._state = self._judged(t_ms, common) if alarmed else DriftState("ok", t_ms, self.looks)
        return self._state

    def _judged(self, t_ms: int, common: float) -> DriftState:
        since_ms = self._state.since_ms or t_ms
        found = self._survey()
        if found.exchanged is not None:
            return exchanged_state(found.exchanged, self.places_m, t_ms, self.looks, since_ms)
        worst = found.suspect
        if worst is None:
            return DriftState("drifting", t_ms, self.looks, common_mm=round(common), since_ms=since_ms)
        off_mm, sigma_mm = round(worst.off_m * 1000), round(worst.sigma_m * 1000)
        moved = worst.significant and off_mm >= MOVED_MM
        return DriftState(
            "moved" if moved else "drifting",
            t_ms,
            self.looks,
            anchor_id=worst.anchor_id,
            off_mm=off_mm,
            sigma_mm=sigma_mm,
            common_mm=round(common),
            since_ms=since_ms,
        )

    def _survey(self) -> SelfSurvey:
        """Which anchor's move, or which two's exchange, explains the last ranges best, if that is more than chance."""
        expected = {pair: self.baseline.pairs[pair].range_mm / 1000 for pair in self._recent}
        return self_survey(
            self.places_m,
            {pair: value.range_mm / 1000 for pair, value in self._recent.items()},
            sigma_m={
                pair: math.hypot(value.sigma_mm, self.baseline.pairs[pair].sigma_mm, FLOOR_MM) / 1000
                for pair, value in self._recent.items()
            },
            priors=Priors(common_m=COMMON_MM / 1000, unit_m=0.005, place_m=dict.fromkeys(self.places_m, 0.002)),
            expected_m=expected,
        )


def exchanged_state(pair: Pair, places_m: Places, t_ms: int, looks: int, since_ms: int) -> DriftState:
    """Two anchors that stand in each other's place: each is off by as much as they are apart."""
    one, other = pair
    off_mm = round(math.dist(places_m[one], places_m[other]) * 1000)
    return DriftState("moved", t_ms, looks, one, off_mm, since_ms=since_ms, exchanged_with=other)
