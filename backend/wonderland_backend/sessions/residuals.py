"""What each range of a session says against the claim, and against the estimate: the contract's own residuals."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import Any

from wonderland.proofs.calibrated import calibrated
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.drift import widened
from wonderland.proofs.drone_clock import drone_clock, on_the_pads_clock
from wonderland.proofs.errors import GeometryError
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.reduction import bias_at, residuals_of
from wonderland.proofs.rounds import UsableRounds, usable


def residuals(session: Session, survey: Commissioning, evidence: Evidence, verdict: Verdict) -> list[dict[str, Any]]:
    """For each anchor: rounds, measured minus claimed and minus estimated (mm), and how far noise and bias reach."""
    commissioning = calibrated(survey, session.calibration)
    if evidence.drift_sigma_mm is not None:
        commissioning = widened(commissioning, evidence.drift_sigma_mm)
    rounds = usable(evidence.ranges, [each.anchor_id for each in commissioning.anchors], commissioning.max_range_mm)
    claims = on_the_pads_clock((session.claim, *evidence.claims), drone_clock(evidence.clock))
    try:
        path = ClaimedPath(commissioning.frame, claims)
    except GeometryError:
        return []
    against_claim = _by_anchor(rounds, commissioning, path)
    moved = _towards_the_claim(commissioning, verdict)
    against_estimate = {} if moved is None else _by_anchor(rounds, moved, path)
    return [
        {
            "anchor_id": commissioning.anchors[index].anchor_id,
            "t_ms": [t_ms for t_ms, _, _ in points],
            "claim_mm": [round(residual) for _, _, residual in points],
            "estimate_mm": [round(residual) for _, _, residual in against_estimate[index]] if moved else None,
            "sigma_mm": round(_sigma_mm(commissioning, commissioning.anchors[index], points[0][1])),
        }
        for index, points in against_claim.items()
        if points
    ]


def _by_anchor(
    rounds: UsableRounds, commissioning: Commissioning, path: ClaimedPath
) -> dict[int, list[tuple[int, int, float]]]:
    """For each anchor (time, range, residual) of the rounds in which it has one."""
    seen = residuals_of(rounds, commissioning, path)
    if seen is None:
        return {}
    found = {}
    for (index, moments, values), column in zip(seen.raw, rounds.range_mm, strict=True):
        heard = [seen.claimed.kept[moment] for moment in moments]
        found[index] = [
            (rounds.t_ms[position], column[position], value) for position, value in zip(heard, values, strict=True)
        ]
    return found


def _towards_the_claim(commissioning: Commissioning, verdict: Verdict) -> Commissioning | None:
    """The pad moved by claim minus estimate: seen from there the claimed path is the estimated one."""
    if verdict.estimate is None or verdict.signed is None:
        return None
    claim, estimate = verdict.signed.claim, verdict.estimate
    east, north = claim.east_mm - estimate.east_mm, claim.north_mm - estimate.north_mm
    anchors = [
        replace(each, east_mm=each.east_mm + east, north_mm=each.north_mm + north) for each in commissioning.anchors
    ]
    return replace(commissioning, anchors=tuple(anchors))


def _sigma_mm(commissioning: Commissioning, anchor: Anchor, range_mm: int) -> float:
    """Standard deviation of one range where nobody lies: noise, bias, survey and installation."""
    _, bias = bias_at(anchor, float(range_mm))
    parts = (commissioning.range_sigma_mm, bias, anchor.survey_sigma_mm, commissioning.installation_sigma_mm)
    return sqrt(sum(part * part for part in parts))
