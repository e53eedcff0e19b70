"""What a drone's calibration may do in a verdict: explain contradictions among the ranges, and never move a place.

A calibration is somebody's word, and one that is false by b moves a drone outside of the anchors' hull by b towards the
pad or away from it, without any contradiction. So the ranges are judged twice: corrected, and as they were measured
with the contradictions excused that such an offset makes. Verified, and refuted, is what both say. Whoever registers a
false offset, or has his drone measured with one, wins no place that the ranges as they are do not give him, and
convicts nobody by it either.
"""

from __future__ import annotations

from dataclasses import replace

from wonderland.proofs.reasons import nearest, reason
from wonderland.proofs.records.verdicts import Reason
from wonderland.proofs.steps import Case, Findings
from wonderland.proofs.vertical import Vertical


def as_measured(case: Case, found: Findings, measured: Case) -> Case:
    """The case for the second look: ranges alone, with the pad's commissioning as it stands (``measured``).

    Time differences are no matter of a common offset, and were judged with the first look; an anchor that is bad with
    the calibration is bad without it.
    """
    suspects = found.measured.agreement.suspects if found.measured is not None else ()
    session = replace(
        case.session, calibration=None, witness=None, policy=replace(case.session.policy, min_assurance=0)
    )
    return replace(
        measured,
        session=session,
        evidence=replace(case.evidence, time_stamps=None),
        witness=None,
        excused=suspects,
    )


def hold_both(found: Findings, plain: Findings, case: Case, offset_mm: int) -> None:
    """Leave of what was found with the calibration (``found``) what holds without it (``plain``) as well.

    An offset moves a height much farther than a place on the map, so that an honest drone may seem to contradict its
    height as measured; that withholds no more than the proof of the height, and only where as measured the ranges fit
    some place in space: where none does, and one does corrected, they bear the offset out themselves.
    """
    excluded = found.timed is not None and found.timed.excludes
    open_there = plain.more_rounds if plain.on_the_map == "inconclusive" else -1
    there = plain.outcome if found.outcome == "refuted" else plain.on_the_map
    if found.outcome == "inconclusive":
        hopeless = plain.on_the_map == "inconclusive" and plain.more_rounds < 0
        found.more_rounds = -1 if hopeless or found.more_rounds < 0 else max(found.more_rounds, open_there)
    elif found.outcome != there and not (found.outcome == "refuted" and excluded):
        _leave_open(found, reason("calibration_alone", offset_mm=offset_mm), open_there)
    doubtful = plain.height is not None and plain.height.outcome != "proved"
    if doubtful and found.height is not None and found.height.outcome == "proved":
        _leave_height_open(found, found.height, plain.height, case)


def _leave_open(found: Findings, why: Reason, more_rounds: int) -> None:
    found.outcome, found.more_rounds = "inconclusive", more_rounds
    if found.signed is not None:
        found.signed = replace(found.signed, outcome="inconclusive")
    found.reasons.items.append(why)


def _leave_height_open(found: Findings, height: Vertical, plain: Vertical | None, case: Case) -> None:
    """The height is the drone's word within what both looks leave open."""
    low, high = height.low, height.high
    if plain is not None:
        low, high = min(low, plain.low), max(high, plain.high)
    found.height = replace(height, outcome="claimed", low=low, high=high)
    for position, each in enumerate(found.reasons.items):
        if each.code == "height_proved":
            found.reasons.items[position] = reason("height_open", lowest_mm=nearest(low), highest_mm=nearest(high))
            if case.policy.height_required:
                _leave_open(found, reason("height_not_proved", geometry="leaves_open"), -1)
