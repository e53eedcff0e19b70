"""One session as lists and the live map show it, put together from the ledger and from what agents report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Final

import orjson

from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland_backend.mirror.rows import OUTLINE, SessionWrite

LEDGER, PAD, UAV = "ledger", "pad", "uav"
_RANK: Final = {LEDGER: 0, PAD: 1, UAV: 2}
_ORDER: Final = {name: index for index, name in enumerate(STEP_NAMES)}


@dataclass(frozen=True, slots=True)
class ReportedStep:
    """A step as the pad's or the drone's agent reported it, or as the evidence lists it."""

    step: str
    t_ms: int
    ok: bool
    source: str
    detail: str | None = None
    agent_id: str = ""
    """Which agent reported it."""

    def to_json(self) -> dict[str, Any]:
        """As the interfaces show it."""
        shown: dict[str, Any] = {"step": self.step, "t_ms": self.t_ms, "ok": self.ok, "source": self.source}
        if self.detail is not None:
            shown["detail"] = self.detail
        return shown


@dataclass(slots=True)
class SessionView:
    """A session under way or ended. `outline` is its row without the record."""

    outline: SessionWrite
    outcome: str | None = None
    permission: str | None = None
    rounds: int | None = None
    reported: dict[tuple[str, str], ReportedStep] = field(default_factory=dict)
    """By step and source; the latest report counts."""

    @property
    def session_id(self) -> str:
        """The session's identifier."""
        return self.outline.session_id

    @property
    def is_ended(self) -> bool:
        """Whether nothing more will happen."""
        return self.outline.state in {"completed", "cancelled"}

    def report(self, steps: Iterable[ReportedStep]) -> None:
        """Take in steps that agents reported; those of other pads or drones than the session's do not count."""
        parties = {PAD: self.outline.pad_id, UAV: self.outline.uav_id}
        for step in steps:
            if parties.get(step.source) == step.agent_id:
                self.reported[step.step, step.source] = step

    def take_evidence(self, steps_json: str | None) -> None:
        """Take in the steps that the evidence lists, where the pad has not reported them by itself."""
        for step in steps_of_evidence(steps_json):
            self.reported.setdefault((step.step, step.source), step)

    def steps(self) -> list[ReportedStep]:
        """Each step once, in order; the ledger's word before the pad's, the pad's before the drone's."""
        best: dict[str, ReportedStep] = {}
        for step in (*self._committed(), *self.reported.values()):
            known = best.get(step.step)
            if known is None or _RANK[step.source] < _RANK[known.source]:
                best[step.step] = step
        self._date_permission(best)
        return sorted(best.values(), key=lambda each: _ORDER[each.step])

    def _date_permission(self, best: dict[str, ReportedStep]) -> None:
        """The ledger says that there is a permission; when it had effect at the pad, or the drone, they say."""
        committed = best.get("permission")
        if committed is None or committed.source != LEDGER:
            return
        for source in (PAD, UAV):
            told = self.reported.get(("permission", source))
            if told is not None and told.ok == committed.ok and told.t_ms >= committed.t_ms:
                best["permission"] = replace(committed, t_ms=told.t_ms)
                return

    def to_json(self) -> dict[str, Any]:
        """The SessionSummary of the REST and live interfaces."""
        columns = ((name, getattr(self.outline, name)) for name in OUTLINE)
        shown = {name: value for name, value in columns if value is not None}
        shown["request_tx"] = self.outline.session_id
        shown["steps"] = [step.to_json() for step in self.steps()]
        decision = {"outcome": self.outcome, "permission": self.permission, "rounds": self.rounds}
        return shown | {name: value for name, value in decision.items() if value is not None}

    def _committed(self) -> list[ReportedStep]:
        steps = [ReportedStep("request", self.outline.requested_ms, True, LEDGER)]
        decided_ms = self.outline.decided_ms
        if decided_ms is not None:
            steps.append(ReportedStep("verdict", decided_ms, True, LEDGER, self.outcome))
            granted = self.permission == "granted"
            steps.append(ReportedStep("permission", decided_ms, granted, LEDGER, self.permission))
        return steps


def steps_of_evidence(steps_json: str | None) -> list[ReportedStep]:
    """The steps that a pad listed in its evidence."""
    if not steps_json:
        return []
    return [ReportedStep(each["step"], each["t_ms"], True, PAD) for each in orjson.loads(steps_json)]
