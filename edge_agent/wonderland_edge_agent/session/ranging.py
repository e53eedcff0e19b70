"""Step 5 on the pad: rounds come in, the contract's judgement is tried at a few looks, estimates are told meanwhile.

The looks are those of ``stopping.LOOKS``: each costs time on the air. The verdict's error limits would hold at any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from wonderland.proofs.records.sessions import MAX_ATTEMPTED
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.rounds import MIN_ANCHORS
from wonderland.proofs.stopping import LOOKS
from wonderland_edge_agent.session.actions import ReportEstimate
from wonderland_edge_agent.session.evidence import GatheredEvidence
from wonderland_edge_agent.session.gather import Round, RoundGatherer
from wonderland_edge_agent.session.timing import PadTiming

STAMPS_PATIENCE = 25
"""Rounds that a claim which the ranges verify waits for time stamps."""


class Ranging:
    """Rounds, looks and running estimates of one session.

    ``judge(now_ms)``: what the contract would say of what there is. ``stamps_frames``: the pad's nodes share a clock,
    so that a claim that the ranges verify is held against time stamps too, before it is brought before the contract.
    ``measured_ago_ms``: how long nodes have measured when they report.
    """

    def __init__(
        self,
        gathered: GatheredEvidence,
        judge: Callable[[int], Verdict],
        *,
        interval_ms: int,
        measured_ago_ms: int,
        max_rounds: int,
        timing: PadTiming,
        stamps_frames: bool = False,
    ) -> None:
        self._stamps_frames = stamps_frames
        self._settled_at: int | None = None
        self._gathered = gathered
        self._judge = judge
        self._timing = timing
        self._most = min(max_rounds, LOOKS[-1])
        self._interval_ms = interval_ms
        self._measured_ago_ms = measured_ago_ms
        self._start_ms = 0
        self._gatherer = RoundGatherer(gathered.anchor_ids, interval_ms)
        self._running = False
        self._look_by_ms: int | None = None
        """A look is due; it waits until then for a fresh claim."""
        self._looked_twice = False
        """A settled claim is judged once more with the next claim."""
        self._estimated = 0
        self._usable_ms = 0
        self._claim_ms: int | None = None
        self._first_ms = self._last_ms = 0
        self._heard = 0
        self._too_few = 0
        self.partial = 0
        """Rounds since the last usable one in which fewer than three anchors measured."""

    def start(self, now_ms: int) -> None:
        """The codes have matched. What was measured before proves nothing and is left out."""
        self._running = True
        self._start_ms = self._usable_ms = now_ms

    def heard_claim(self, now_ms: int) -> None:
        """A claim of the drone arrived: a look may rest on it for a little while."""
        self._claim_ms = now_ms

    def take(self, anchor_id: str, t_ms: int, range_mm: int | None, *, nlos: bool, now_ms: int) -> None:
        """One report of one node."""
        self._add(self._gatherer.add(anchor_id, t_ms, range_mm, nlos=nlos), now_ms)

    def advance(self, now_ms: int) -> tuple[bool, ReportEstimate | None]:
        """Close a round whose time is up, look if a look is due, estimate if it is time.

        Whether it is enough (settled, hopeless, or the last round), and the estimate, if there is one.
        """
        self._add(self._gatherer.expire(now_ms), now_ms)
        rounds = self._gathered.rounds
        if not self._running or not rounds:
            return False, None
        if self._look_by_ms is not None:
            fresh = self._claim_ms is not None and now_ms - self._claim_ms <= self._timing.fresh_claim_ms
            return self._look(now_ms) if fresh or now_ms >= self._look_by_ms else (False, None)
        if rounds >= self._estimated + self._timing.estimate_every_rounds and self._gathered.claims:
            return False, self._estimate(self._judge(now_ms))
        return False, None

    @property
    def silent_ms(self) -> int:
        """When the drone counts as lost, if no usable round comes before."""
        return self._usable_ms + self._timing.silence_ms

    @property
    def attempted(self) -> int:
        """Rounds gathered, those that too few anchors measured, and those in between that no anchor did.

        A drone's driver can silence all anchors or some of them, in the rounds that do not suit it; so all count that
        were due, whoever kept silent. What no anchor measured is what is missing from the whole time: a pad whose
        reports come late and then all at once has missed nothing. While a look is due the pad itself gathers nothing.
        """
        if not self._heard:
            return 0
        due = round((self._last_ms - self._first_ms) / self._interval_ms) + 1
        silent = max(0, due - self._heard)
        return min(self._gathered.rounds + self._too_few + silent, MAX_ATTEMPTED)

    def next_ms(self) -> int:
        """When ``advance`` will have something to do even if nothing else happens."""
        times = (self.silent_ms, self._gatherer.closes_ms, self._look_by_ms)
        return min(t_ms for t_ms in times if t_ms is not None)

    def _add(self, rounds: list[Round], now_ms: int) -> None:
        for reported in rounds:
            if not self._running:
                return
            complete = replace(reported, t_ms=reported.t_ms - self._measured_ago_ms)
            if complete.t_ms < self._start_ms:
                continue
            self._last_ms = complete.t_ms
            self._first_ms = self._first_ms or complete.t_ms
            self._heard += 1
            if self._look_by_ms is not None:
                continue
            # With too few anchors it decides nothing, and would only cost time on the air. The first one is brought all
            # the same: from its moment on claims were made while the drone was ranged.
            if complete.count < MIN_ANCHORS and self._heard > 1:
                self.partial += 1
                self._too_few += 1
            elif self._gathered.add_round(complete):
                self._usable_ms, self.partial = now_ms, 0
                if self._gathered.rounds in LOOKS or self._gathered.rounds >= self._most:
                    self._look_by_ms = now_ms + self._timing.look_patience_ms

    def _look(self, now_ms: int) -> tuple[bool, ReportEstimate]:
        """Ask whether the contract would be settled."""
        self._look_by_ms = None
        self._usable_ms = now_ms
        verdict = self._judge(now_ms)
        undecided = verdict.outcome == "inconclusive"
        # One look that sees no hope is enough: it allows for two standard deviations of noise already, and of sessions
        # that would still have settled it ends 1 in 100 (simulated at the largest bias with which a pad can verify).
        hopeless = undecided and verdict.more_rounds < 0
        settled = not undecided and not self._awaits_stamps(verdict)
        if settled and not self._looked_twice and self._gathered.rounds > LOOKS[0]:
            # It was open a look ago, so it is near the threshold, where a claim that is still on its way can undo it.
            self._looked_twice = True
            self._claim_ms, self._look_by_ms = None, now_ms + self._timing.look_patience_ms
            return False, self._estimate(verdict)
        self._looked_twice = False
        enough = settled or hopeless or self._gathered.rounds >= self._most
        self._running = not enough
        return enough, self._estimate(verdict)

    def _awaits_stamps(self, verdict: Verdict) -> bool:
        """Whether a settled claim waits a little for the time stamps, whatever assurance the policy demands.

        They need the drone's answer first and come a few rounds later. A drone that does not blink, and a place where
        time stamps tell too little, end the wait.
        """
        if not self._stamps_frames or verdict.outcome != "verified":
            return False
        if self._settled_at is None:
            self._settled_at = self._gathered.rounds
        seen = verdict.time_differences
        open_yet = seen is None or (seen.finding == "vague" and seen.more_frames > 0)
        return open_yet and self._gathered.rounds < self._settled_at + STAMPS_PATIENCE

    def _estimate(self, verdict: Verdict) -> ReportEstimate:
        self._estimated = self._gathered.rounds
        return ReportEstimate(verdict, self._gathered.latest(), self._gathered.last_ms)
