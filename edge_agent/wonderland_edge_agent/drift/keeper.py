"""When the anchors range each other, and what follows from it: one look at a time, only while no session is there."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from wonderland_edge_agent.drift.baseline import Baseline, BaselineError, summary
from wonderland_edge_agent.drift.residuals import ResidualWatch
from wonderland_edge_agent.drift.watch import DriftState, DriftWatch, exchanged_state
from wonderland_edge_agent.radios.between import channel_of
from wonderland_edge_agent.self_survey import Priors, self_survey
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.files import read_bounded, write_atomic

if TYPE_CHECKING:
    from wonderland.clock import Clock
    from wonderland.proofs.records.pads import Commissioning
    from wonderland.proofs.records.verdicts import Verdict
    from wonderland_edge_agent.radios.between import PairRanges

_log = logging.getLogger(__name__)

ROUNDS: Final = 20
FIRST_ROUNDS: Final = 30
COMPLETE_TRIES: Final = 3
"""So often a first look that lacks a pair is tried again before it counts all the same."""
CONTRADICTED_MM: Final = 50.0
"""The survey alone is contradicted by ranges whose units' biases are unknown: less than this is not claimed."""


class AnchorRadios(Protocol):
    """Nodes that can range each other."""

    async def measure_between(self, macs: Mapping[str, int], rounds: int, channel: int) -> PairRanges:
        """Ranges by (leader, follower), mm; empty where a session has come between."""
        ...


class DriftKeeper:
    """One pad's watch over itself: what its anchors measure to each other, and what verified sessions left over."""

    def __init__(self, radios: AnchorRadios, baseline_file: Path, clock: Clock, every_s: float) -> None:
        self.every_s: Final = every_s
        self._radios = radios
        self._baseline_file = baseline_file
        self._state_file = baseline_file.with_name("drift.json")
        self._residuals_file = baseline_file.with_name("residuals.json")
        self._residuals = ResidualWatch()
        self._extra_mm = 0
        self._clock = clock
        self._of = ""
        self._tries = 0
        self._suspect = ""
        self._watch: DriftWatch | None = None
        self._anchors: DriftState | None = None

    @property
    def state(self) -> DriftState | None:
        """The graver one of both findings; None until there is one, and after a new commissioning."""
        anchors, extra_mm = self._anchors, self._extra_mm
        if not extra_mm or (anchors is not None and (anchors.state == "moved" or anchors.extra_sigma_mm >= extra_mm)):
            return anchors
        looks, checked_ms = (anchors.looks, anchors.checked_ms) if anchors is not None else (0, self._clock())
        return DriftState("drifting", checked_ms, looks, sigma_mm=extra_mm, since_ms=self._residuals.since_ms)

    def load(self, commissioning_sha256: str, commissioning: Commissioning) -> None:
        """Take up the watch over this commissioning, with what was found before a restart."""
        if self._of == commissioning_sha256:
            return
        self._of, self._watch, self._anchors = commissioning_sha256, None, self._kept(commissioning_sha256)
        self._tries, self._suspect = 0, ""
        try:
            self._residuals = ResidualWatch.load(self._residuals_file, commissioning_sha256)
        except BaselineError as error:
            _log.warning("%s", error)
            self._residuals = ResidualWatch()
        self._extra_mm = self._residuals.extra_sigma_mm(commissioning)
        try:
            baseline = Baseline.load(self._baseline_file, commissioning_sha256)
        except BaselineError as error:
            _log.warning("%s", error)
            baseline = None
        if baseline is not None:
            self._watch = self._over(baseline, commissioning)

    def moved(self, commissioning_sha256: str) -> bool:
        """Whether an anchor stands elsewhere than this commissioning says: then nothing can be proved with it."""
        return self._of == commissioning_sha256 and self._anchors is not None and self._anchors.state == "moved"

    def why_moved(self, commissioning_sha256: str) -> str:
        """What stands elsewhere and what to do; empty where nothing does."""
        return _words(self._anchors) if self._anchors is not None and self.moved(commissioning_sha256) else ""

    def extra_sigma_mm(self, commissioning_sha256: str) -> int | None:
        """What the pad has to add to its anchors' uncertainty; None while they are as this commissioning found them."""
        state = self.state
        if self._of != commissioning_sha256 or state is None:
            return None
        return state.extra_sigma_mm or None

    def decided(
        self, verdict: Verdict, commissioning_sha256: str, commissioning: Commissioning, added_mm: int | None
    ) -> None:
        """A session of this pad was decided, with ``added_mm`` said in its evidence: learn from what it left over."""
        self.load(commissioning_sha256, commissioning)
        if not self._residuals.take_verdict(verdict, commissioning, added_mm or 0):
            return
        before, self._extra_mm = self._extra_mm, self._residuals.extra_sigma_mm(commissioning)
        if self._extra_mm and not before:
            _log.warning(
                "verified sessions contradict the commissioning; %d mm of uncertainty are added to each anchor, and "
                "the pad should be commissioned again",
                self._extra_mm,
            )
        try:
            self._residuals.save(self._residuals_file, commissioning_sha256)
        except LedgerError as error:
            _log.warning("what sessions left over is not kept: %s", error)

    async def measure_and_judge(self, commissioning_sha256: str, commissioning: Commissioning) -> DriftState | None:
        """Measure and judge once; the state after it."""
        self.load(commissioning_sha256, commissioning)
        macs = {anchor.anchor_id: anchor.mac for anchor in commissioning.anchors}
        channel = channel_of(commissioning)
        rounds = ROUNDS if self._watch is not None else FIRST_ROUNDS
        ranges = await self._radios.measure_between(macs, rounds, channel)
        measured = summary(ranges)
        if not measured:
            return self.state
        before = self._anchors
        if self._watch is not None:
            self._anchors = self._watch.judge_pairs(self._clock(), measured)
        elif not self._learn(ranges, commissioning):
            # It closes the pad, so that one look is not enough: a bad moment of the air names an anchor, too.
            again = await self._radios.measure_between(macs, FIRST_ROUNDS, channel)
            if summary(again):
                self._learn(again, commissioning)
        if self._anchors is not None and (before is None or before.state != self._anchors.state):
            self._tell(self._anchors)
        return self.state

    def _learn(self, ranges: PairRanges, commissioning: Commissioning) -> bool:
        """No baseline of the commissioning is here: the first look is one, unless it contradicts the survey.

        False where it does and has to be repeated: an anchor was moved where two looks running name it.
        """
        baseline = Baseline.of(ranges, t_ms=self._clock(), source="first look")
        count = len(commissioning.anchors)
        self._tries += 1
        if len(baseline.pairs) < count * (count - 1) // 2 and self._tries < COMPLETE_TRIES:
            return True  # a node is away or hidden from another: what it would measure is worth waiting for
        found = self_survey(
            _places(commissioning),
            {pair: value.range_mm / 1000 for pair, value in baseline.pairs.items()},
            priors=Priors(
                place_m={anchor.anchor_id: max(anchor.survey_sigma_mm, 1) / 1000 for anchor in commissioning.anchors}
            ),
        )
        suspect, now_ms = found.suspect, self._clock()
        if found.exchanged is not None:
            if self._suspect != str(found.exchanged):
                self._suspect = str(found.exchanged)
                return False
            self._anchors = exchanged_state(found.exchanged, _places(commissioning), now_ms, 1, now_ms)
            return True
        if suspect is not None and suspect.off_m * 1000 >= CONTRADICTED_MM:
            if suspect.anchor_id != self._suspect:
                self._suspect = suspect.anchor_id
                return False
            self._anchors = DriftState(
                "moved",
                now_ms,
                1,
                anchor_id=suspect.anchor_id,
                off_mm=round(suspect.off_m * 1000),
                sigma_mm=round(suspect.sigma_m * 1000),
                since_ms=now_ms,
            )
            return True
        self._suspect = ""
        self._watch = self._over(baseline, commissioning)
        self._anchors = DriftState("ok", baseline.t_ms, 1)
        try:
            baseline.save(self._baseline_file, self._of)
        except (LedgerError, OSError) as error:
            _log.warning("the anchors' ranges to each other are not kept: %s", error)
        return True

    def _over(self, baseline: Baseline, commissioning: Commissioning) -> DriftWatch:
        return DriftWatch(baseline, _places(commissioning), self.every_s)

    def _tell(self, state: DriftState) -> None:
        if state.state == "ok":
            _log.info("the anchors measure to each other what they did when they were commissioned")
        elif state.state == "moved":
            _log.error("nothing is proved: %s", _words(state))
        else:
            _log.warning(
                "the anchors no longer measure to each other what they did when commissioned; %d mm of uncertainty are "
                "added to each, and the pad should be commissioned again",
                state.extra_sigma_mm,
            )
        try:
            write_atomic(self._state_file, json.dumps({"commissioning": self._of, **asdict(state)}).encode() + b"\n")
        except LedgerError as error:
            _log.warning("what the anchors say of each other is not kept: %s", error)

    def _kept(self, commissioning_sha256: str) -> DriftState | None:
        """What the last look before a restart found."""
        if not self._state_file.exists():
            return None
        try:
            value: Any = json.loads(read_bounded(self._state_file, BaselineError, "drift"))
            if value.pop("commissioning") != commissioning_sha256:
                return None
            state = DriftState(**value)
        except (LedgerError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            _log.warning("%s is not used: %s", self._state_file, error)
            return None
        return state if state.state in {"ok", "drifting", "moved"} else None


def _words(moved: DriftState) -> str:
    if moved.exchanged_with:
        one, other = moved.anchor_id, moved.exchanged_with
        return f"anchors {one} and {other} are exchanged: exchange their ports in pad.toml, or the nodes themselves"
    return (
        f"anchor {moved.anchor_id} stands about {moved.off_mm} mm from where it was commissioned: put it back, or "
        "commission the pad again (wonderland pad commission)"
    )


def _places(commissioning: Commissioning) -> dict[str, tuple[float, float, float]]:
    return {
        anchor.anchor_id: (anchor.east_mm / 1000, anchor.north_mm / 1000, anchor.up_mm / 1000)
        for anchor in commissioning.anchors
    }
