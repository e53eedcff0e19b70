"""The pad's looks at a batch of tries, as in the agent's ``ranging``, until each is settled or out of rounds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.verdict import decide
from wonderland_research.attack_lab.batch import Batch, won_at_moments, wrongful
from wonderland_research.attack_lab.places import ROUND_MS, START_MS, Booleans, Integers
from wonderland_research.attack_lab.screen import Look, screen_looks

_LOOK_AGAIN: Final = (LOOKS[len(LOOKS) // 2], LOOKS[-1])
"""Tries that are stuck are looked at again only then."""
DECIDED_MS: Final = START_MS + 20_000


class LabError(Exception):
    """The lab contradicts the decision that it measures: nothing that it counted may be believed."""


@dataclass
class Tally:
    """What became of the tries of one attack at one level."""

    tries: int = 0
    won: int = 0
    """Permissions that the attacker should not have."""
    granted: int = 0
    """All permissions, or whatever else an attack on the protocol is after."""
    refuted: int = 0
    open: int = 0
    refused: int = 0
    """Tries that the contract, or the link, did not even take."""
    detected_rounds: list[int] = field(default_factory=list)
    """Rounds after which each refuted try was refuted."""
    error_won_mm: list[int] = field(default_factory=list)
    """How far the drone was from its claim where the attacker won."""
    error_refuted_mm: list[int] = field(default_factory=list)
    """How far it was when it was refuted."""
    error_granted_mm: list[int] = field(default_factory=list)
    """How far it was with each permission more than a buffer from its claim, the attacker's success or not."""
    sampled: int = 0
    """Looks at which the screen was compared with the decision."""
    decisions: int = 0
    """Decisions that were computed by the contract's own function."""
    reasons: dict[str, int] = field(default_factory=dict)
    """Codes of what the decision said in the looks that it was asked about."""

    def add(self, other: Tally) -> None:
        """Take another one's counts."""
        for name in ("tries", "won", "granted", "refuted", "open", "refused", "sampled", "decisions"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.detected_rounds += other.detected_rounds
        self.error_won_mm += other.error_won_mm
        self.error_refuted_mm += other.error_refuted_mm
        self.error_granted_mm += other.error_granted_mm
        for code, count in other.reasons.items():
            self.reasons[code] = self.reasons.get(code, 0) + count


def verdict_of(batch: Batch, index: int, rounds: int) -> Verdict:
    """The contract's decision on one try: codes matched, countersigned, authorised. The attacker has all of that."""
    return decide(
        batch.session(index),
        batch.commissioning,
        batch.evidence(index, rounds),
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=DECIDED_MS,
        evidence_sha256="0" * 64,
        witness=batch.witnessed(index, rounds),
    )


def run_batch(batch: Batch, *, sample: int, screened: bool = True) -> Tally:
    """Play all tries to their end. ``sample``: of so many, each look is compared with the decision.

    Raises LabError where the screen and the decision differ.
    """
    tally = Tally(tries=len(batch))
    bad = wrongful(batch)
    alive = np.arange(len(batch))
    stuck = np.zeros(len(batch), dtype=bool)
    screened = screened and batch.may_be_screened
    for rounds in LOOKS:
        if rounds in _LOOK_AGAIN:
            stuck[:] = False
        every, alive = alive, alive[~stuck[alive]]
        answers = screen_looks(batch, alive, rounds) if screened else np.full(len(alive), Look.ASK, dtype=np.int64)
        if screened:
            _compare(batch, alive, answers, rounds, sample, tally)
        settled = answers == Look.REFUTED
        for row in alive[settled]:
            _refuted(batch, tally, int(row), rounds)
        for position in np.nonzero(answers == Look.ASK)[0]:
            row = int(alive[position])
            verdict = verdict_of(batch, row, rounds)
            tally.decisions += 1
            if verdict.outcome == "refuted":
                _refuted(batch, tally, row, rounds)
            elif verdict.outcome == "verified":
                _verified(batch, tally, row, rounds, verdict, bad)
            # The pad ends it there; where looks are screened the lab looks on, so that both ways count the same.
            hopeless = not batch.may_be_screened and verdict.more_rounds < 0
            settled[position] = verdict.outcome != "inconclusive" or hopeless
            tally.open += verdict.outcome == "inconclusive" and hopeless
            for reason in verdict.reasons:
                tally.reasons[reason.code] = tally.reasons.get(reason.code, 0) + 1
        stuck[alive[answers == Look.STUCK]] = True
        alive = np.setdiff1d(every, alive[settled], assume_unique=True)
    tally.open += len(alive)
    return tally


def seconds(rounds: float) -> float:
    """Ranging time of so many rounds."""
    return rounds * ROUND_MS / 1000.0


def _refuted(batch: Batch, tally: Tally, row: int, rounds: int) -> None:
    tally.refuted += 1
    if batch.won_if_refuted:
        tally.won += 1
        tally.error_won_mm.append(int(batch.off_mm[row, rounds - 1]))
    tally.detected_rounds.append(rounds)
    tally.error_refuted_mm.append(int(batch.off_mm[row, rounds - 1]))


def _verified(batch: Batch, tally: Tally, row: int, rounds: int, verdict: Verdict, bad: Booleans) -> None:
    granted = verdict.permission == "granted"
    tally.granted += granted
    if granted and batch.truth_mm is not None:
        won, away_mm = won_at_moments(batch, row, rounds, verdict)
        if won:
            tally.won += 1
            tally.error_won_mm.append(away_mm)
        return
    if granted and batch.off_mm[row, rounds - 1] > batch.policy.buffer_mm:
        tally.error_granted_mm.append(int(batch.off_mm[row, rounds - 1]))
    if granted and bad[row, rounds - 1]:
        tally.won += 1
        tally.error_won_mm.append(int(batch.off_mm[row, rounds - 1]))


def _compare(batch: Batch, alive: Integers, answers: Integers, rounds: int, sample: int, tally: Tally) -> None:
    for position in np.nonzero((alive < sample) & (answers != Look.ASK))[0]:
        row = int(alive[position])
        outcome = verdict_of(batch, row, rounds).outcome
        tally.sampled += 1
        expected = "refuted" if answers[position] == Look.REFUTED else "inconclusive"
        if outcome != expected:
            raise LabError(
                f"after {rounds} rounds of try {row} the screen says {expected} and the decision {outcome}; "
                "repeat with --exact, and report it"
            )
