"""What a pad's anchors measured to each other when it was commissioned."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.files import read_bounded, write_atomic

MIN_RANGES: Final = 5
MAX_PAIRS: Final = 120
"""Of sixteen anchors."""
_TO_SIGMA: Final = 1.4826
_MEDIAN_LOSS: Final = 1.2533
"""A median of n values is known to σ·√(π/2)/√n."""
QUANTISATION_MM: Final = 2.9
"""Nodes report whole centimetres: 10/√12."""


class BaselineError(LedgerError):
    """A file that holds no baseline."""


@dataclass(frozen=True, slots=True)
class PairBaseline:
    """One pair's range, and how well one measurement of it (as many rounds) is known. Millimetres."""

    range_mm: float
    sigma_mm: float


@dataclass(frozen=True, slots=True)
class Baseline:
    """All pairs by (anchor, anchor) in alphabetical order, when they were measured (ms), and on what occasion."""

    pairs: Mapping[tuple[str, str], PairBaseline]
    t_ms: int
    source: str

    @classmethod
    def of(cls, ranges_mm: Mapping[tuple[str, str], list[int]], *, t_ms: int, source: str) -> Self:
        """From ranges by (leader, follower); a pair with too few is left out."""
        return cls(summary(ranges_mm), t_ms, source)

    def to_json(self) -> dict[str, Any]:
        """As it is kept in a file."""
        return {
            "t_ms": self.t_ms,
            "source": self.source,
            "pairs": [[*pair, round(p.range_mm, 1), round(p.sigma_mm, 2)] for pair, p in self.pairs.items()],
        }

    @classmethod
    def parse(cls, value: Any) -> Self:
        """From a kept file. Raises BaselineError."""
        try:
            rows = value["pairs"]
            if len(rows) > MAX_PAIRS:
                raise BaselineError(f"a baseline of {len(rows)} pairs")
            pairs = {(str(one), str(other)): PairBaseline(float(r), float(s)) for one, other, r, s in rows}
            if not all(math.isfinite(p.range_mm) and p.range_mm > 0 and 0 < p.sigma_mm < 1e4 for p in pairs.values()):
                raise BaselineError("a baseline with ranges that are none")
            return cls(pairs, int(value["t_ms"]), str(value["source"]))
        except (KeyError, TypeError, ValueError, OverflowError) as cause:
            raise BaselineError(f"no baseline of ranges between anchors ({cause})") from cause

    def save(self, path: Path, commissioning_sha256: str) -> None:
        """Keep it, durably, for the commissioning that it belongs to. Raises LedgerError (FileWriteError)."""
        value = {"commissioning_sha256": commissioning_sha256, **self.to_json()}
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_atomic(path, json.dumps(value).encode() + b"\n")

    @classmethod
    def load(cls, path: Path, commissioning_sha256: str) -> Self | None:
        """The one of this commissioning; None where there is none, or one of another. Raises BaselineError."""
        if not path.exists():
            return None
        data = read_bounded(path, BaselineError, "baseline")
        try:
            value = json.loads(data)
        except (ValueError, RecursionError) as cause:
            raise BaselineError(f"{path}: no baseline ({cause}); remove it, and it is measured anew") from cause
        if not isinstance(value, dict) or value.get("commissioning_sha256") != commissioning_sha256:
            return None
        try:
            return cls.parse(value)
        except BaselineError as cause:
            raise BaselineError(f"{path}: {cause}; remove it, and it is measured anew") from cause


def hear_each_other(path: Path, commissioning_sha256: str) -> bool:
    """Whether this commissioning's anchors have ranged each other, then or since; False where nobody can tell."""
    try:
        kept = Baseline.load(path, commissioning_sha256)
    except BaselineError:
        return False
    return kept is not None and bool(kept.pairs)


def median(values: Iterable[float]) -> float:
    """As ``statistics.median``, which a running pad would load for this alone."""
    ordered = sorted(values)
    half = len(ordered) // 2
    return float(ordered[half]) if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2.0


def summary(ranges_mm: Mapping[tuple[str, str], list[int]]) -> dict[tuple[str, str], PairBaseline]:
    """Each pair's range: the mean of both directions' medians, with its standard deviation."""
    both: dict[tuple[str, str], list[PairBaseline]] = {}
    for (one, other), values in sorted(ranges_mm.items()):
        if len(values) < MIN_RANGES:
            continue
        middle = median(values)
        spread = max(_TO_SIGMA * median(abs(value - middle) for value in values), QUANTISATION_MM)
        known = PairBaseline(middle, _MEDIAN_LOSS * spread / math.sqrt(len(values)))
        both.setdefault((one, other) if one < other else (other, one), []).append(known)
    return {
        pair: PairBaseline(
            sum(item.range_mm for item in found) / len(found),
            math.sqrt(sum(item.sigma_mm**2 for item in found)) / len(found),
        )
        for pair, found in sorted(both.items())
    }
