"""What verified sessions say of a pad's calibration: their ranges should contradict one another as little as it states.

The χ² of a session's ranges about their estimate is, where bias tables and survey are as commissioned, on average the
number of anchors less two. Were the anchors' errors twice the variance that is stated, it would be twice that. The
evidence for the second over the first is summed as CUSUM does, session by session: a false alarm comes once in
``FALSE_ALARM_SESSIONS`` at most, on average. Its size follows from the mean since the sum was last zero.

Only verified sessions count: one that a drone's own lies made contradictory says nothing of the pad, and refused drones
could make a pad as vague as they like. No numerics library: a running pad carries this.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.special import CHI2_LIMITS
from wonderland_edge_agent.drift.baseline import BaselineError
from wonderland_fabric_gateway.files import read_bounded, write_atomic

WORSE: Final = 2.0
"""The variance that is looked for, over the one that was commissioned."""
FALSE_ALARM_SESSIONS: Final = 10_000
LIMIT: Final = math.log(FALSE_ALARM_SESSIONS)
MOST: Final = LIMIT + 6.0
"""The sum is held here; so some twenty good sessions end an alarm."""
LARGEST_CHI2: Final = 40.0
"""One session counts as no more than this: it takes several to tell."""


@dataclass(slots=True)
class ResidualWatch:
    """The sum, and what was seen since it was last zero."""

    evidence: float = 0.0
    chi2: float = 0.0
    freedom: int = 0
    since_ms: int = 0

    @property
    def alarmed(self) -> bool:
        """Whether the residuals have drifted from the commissioning."""
        return self.evidence >= LIMIT

    def extra_sigma_mm(self, commissioning: Commissioning) -> int:
        """What to add to each anchor's uncertainty so that the stated one is right again; 0 while all is well."""
        if not self.alarmed or self.freedom == 0:
            return 0
        return math.ceil(math.sqrt(max(self.chi2 / self.freedom - 1.0, 0.0)) * stated_mm(commissioning))

    def take_verdict(self, verdict: Verdict, commissioning: Commissioning, added_mm: int) -> bool:
        """One decided session, judged with ``added_mm`` on each anchor; whether it told anything."""
        codes = {reason.code for reason in verdict.reasons}
        freedom = len(commissioning.anchors) - 2
        usable = verdict.outcome == "verified" and not codes & {"anchor_silent", "obstructed"}
        if not usable or verdict.chi2_milli is None or freedom < 1:
            return False
        chi2 = verdict.chi2_milli / 1000.0
        if "ranges_inconsistent" in codes:
            chi2 = CHI2_LIMITS[freedom - 1]  # said is what the others leave without the anchor at fault; all left more
        stated = stated_mm(commissioning)
        # Judged with a wider error it seemed smaller than about the commissioning itself.
        wider = (stated * stated + added_mm * added_mm) / (stated * stated)
        chi2 = min(chi2 * wider, LARGEST_CHI2)
        gain = 0.5 * (1.0 - 1.0 / WORSE) * chi2 - 0.5 * freedom * math.log(WORSE)
        self.evidence = min(max(self.evidence + gain, 0.0), MOST)
        if self.evidence == 0.0:
            self.chi2, self.freedom, self.since_ms = 0.0, 0, 0
        else:
            self.since_ms = self.since_ms or verdict.decided_ms
            self.chi2, self.freedom = self.chi2 + chi2, self.freedom + freedom
        return True

    def save(self, path: Path, commissioning_sha256: str) -> None:
        """Keep it for the commissioning that it belongs to. Raises LedgerError (FileWriteError)."""
        value = {
            "commissioning_sha256": commissioning_sha256,
            "evidence": round(self.evidence, 4),
            "chi2": round(self.chi2, 3),
            "freedom": self.freedom,
            "since_ms": self.since_ms,
        }
        write_atomic(path, json.dumps(value).encode() + b"\n")

    @classmethod
    def load(cls, path: Path, commissioning_sha256: str) -> Self:
        """The one of this commissioning; a fresh one where there is none. Raises BaselineError."""
        if not path.exists():
            return cls()
        try:
            value: Any = json.loads(read_bounded(path, BaselineError, "residuals"))
            if not isinstance(value, Mapping):
                raise BaselineError(f"{path}: no residuals; remove it, and they are learnt anew")
            if value.get("commissioning_sha256") != commissioning_sha256:
                return cls()
            found = cls(float(value["evidence"]), float(value["chi2"]), int(value["freedom"]), int(value["since_ms"]))
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as cause:
            raise BaselineError(f"{path}: no residuals ({cause}); remove it, and they are learnt anew") from cause
        numbers = (found.evidence, found.chi2, float(found.freedom), float(found.since_ms))
        if not all(math.isfinite(number) and number >= 0.0 for number in numbers):
            raise BaselineError(f"{path}: residuals that are none; remove it, and they are learnt anew")
        return found


def stated_mm(commissioning: Commissioning) -> float:
    """What the commissioning says that an anchor's range is off by, apart from noise (1σ, mean of all)."""
    total = 0.0
    for anchor in commissioning.anchors:
        bias = sum(point.sigma_mm**2 for point in anchor.bias) / len(anchor.bias)
        total += bias + anchor.survey_sigma_mm**2
    return max(math.sqrt(total / len(commissioning.anchors)), 1.0)
