"""How a session's likelihood went, round by round: the contract's own decision on what had been measured by then.

Only the last point is the verdict that stands on the ledger. The others are recomputed here from the evidence that the
pad brought, for whoever wants to see how the decision came about.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from typing import Any, Final

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import AnchorTicks, Evidence, RangeTable, Session, TimeStamps
from wonderland.proofs.records.verdicts import BroadcastFinding, Judgement, Verdict
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.verdict import decide

FIRST: Final = 1
_CLAIM_LAG_MS: Final = 200
"""Claims come ten a second: the one after a round belongs to it, too."""


def course_of(
    session: Session, commissioning: Commissioning | None, evidence: Evidence, verdict: Verdict
) -> list[dict[str, Any]]:
    """A point for each look: `rounds`, `t_ms`, `outcome`, and of each claim likelihood (ppm) and distance (mm).

    Where the survey on which it was decided is not known, nothing can be recomputed: then there is the verdict alone.
    """
    total = len(evidence.ranges.t_ms)
    points = []
    for rounds in [number for number in (FIRST, 2, 3, 5, 7, *LOOKS) if number < total]:
        if commissioning is None:
            break
        known = _known_after(evidence, rounds)
        now_ms = min(known.ranges.t_ms[-1] + _CLAIM_LAG_MS, verdict.decided_ms)
        signed = None if evidence.uav_signature is None else True
        found = decide(
            session,
            commissioning,
            known,
            confirmed=evidence.matched == "both",
            signature_valid=signed,
            authorisation=(),
            now_ms=now_ms,
            evidence_sha256=verdict.evidence_sha256,
        )
        points.append(_point(rounds, known.ranges.t_ms[-1], found))
    if total:
        points.append(_point(total, evidence.ranges.t_ms[-1], verdict))
    return points


def _point(rounds: int, t_ms: int, verdict: Verdict) -> dict[str, Any]:
    point: dict[str, Any] = {"rounds": rounds, "t_ms": t_ms, "outcome": verdict.outcome}
    for name in ("signed", "broadcast"):
        judgement: Judgement | BroadcastFinding | None = getattr(verdict, name)
        # What somebody else may have sent says nothing of how likely the drone is where it says.
        if judgement is None or judgement.outcome == "contradicted":
            continue
        if judgement.likelihood_ppm is not None:
            point[name] = {"likelihood_ppm": judgement.likelihood_ppm, "error_mm": judgement.error_mm}
    return point


def _known_after(evidence: Evidence, rounds: int) -> Evidence:
    """What a pad had after so many rounds."""
    table = evidence.ranges
    until_ms = table.t_ms[rounds - 1] + _CLAIM_LAG_MS
    anchors = tuple(
        replace(
            anchor,
            range_mm=anchor.range_mm[:rounds],
            nlos=tuple(index for index in anchor.nlos if index < rounds),
        )
        for anchor in table.anchors
    )
    attempted = evidence.radio.attempted_rounds
    by_then = None if attempted is None else attempted * rounds // len(table.t_ms)
    return replace(
        evidence,
        ranges=RangeTable(t_ms=table.t_ms[:rounds], anchors=anchors),
        claims=tuple(claim for claim in evidence.claims if claim.t_ms <= until_ms),
        broadcast=tuple(claim for claim in evidence.broadcast if claim.t_ms <= until_ms),
        radio=replace(evidence.radio, attempted_rounds=by_then),
        time_stamps=None if evidence.time_stamps is None else _stamped_until(evidence.time_stamps, until_ms),
    )


def _stamped_until(stamps: TimeStamps, until_ms: int) -> TimeStamps:
    times, t_ms = [], stamps.start_ms
    for gap_ms in stamps.gap_ms:
        t_ms += gap_ms
        times.append(t_ms)
    frames = bisect_right(times, until_ms)
    anchors = tuple(AnchorTicks(anchor_id=each.anchor_id, ticks=each.ticks[:frames]) for each in stamps.anchors)
    return replace(stamps, gap_ms=stamps.gap_ms[:frames], anchors=anchors)
