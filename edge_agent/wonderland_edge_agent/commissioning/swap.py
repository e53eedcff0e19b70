"""A broken node is replaced by another one in the same mount: what its neighbours' ranges say of it, and the record.

Every range of the new node differs from its predecessor's by what their antenna delays differ; nothing else may have
changed. So the neighbours' ranges among themselves must be those of the commissioning, up to a change that all of them
share (temperature), and the new node's must all differ from the old one's by the same. That difference goes into its
bias table. A table by distance is not calibrated for the new unit, hence ``UNIT_MM`` more uncertainty; its clock is
not either, so that it tells no time differences. A node that stands up to some centimetres beside its predecessor's
place, outwards, cannot be told from one with more delay: ``mount_mm`` has to say how well the mount repeats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning
from wonderland_edge_agent.commissioning.errors import RadioError, SurveyError
from wonderland_edge_agent.drift.baseline import Baseline, PairBaseline, median
from wonderland_edge_agent.drift.watch import FLOOR_MM

MIN_NEIGHBOURS: Final = 3
UNIT_MM: Final = 30.0
"""How far bias curves of two units of a chip differ, once their mean is taken out (1σ)."""
MOST_SIGMAS: Final = 4.0
MOST_DELAY_MM: Final = 1_000.0
"""Antenna delays that nobody set differ by 0.2 to 0.4 m; more is a node that does not range well."""
_MAX_NOTE: Final = 500

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Swapped:
    """What the ranges say of the new node. Lengths in mm."""

    record: Commissioning
    baseline: Baseline
    delay_mm: float
    """How much longer its ranges are than its predecessor's."""
    sigma_mm: float
    worst_mm: float
    """Furthest that one neighbour's range lies from this."""
    neighbours: int
    loses_clock: bool
    """Its predecessor's clock was calibrated, and its own is not."""


def swap(
    commissioning: Commissioning,
    anchor_id: str,
    measured: Mapping[Pair, PairBaseline],
    before: Baseline | None,
    *,
    now_ms: int,
    mount_mm: float,
) -> Swapped:
    """The commissioning with the new node in it. ``before``: what the pairs measured at the commissioning, if kept.

    Raises SurveyError where something else than the node has changed, RadioError where too few neighbours hear it.
    """
    anchors = {anchor.anchor_id: anchor for anchor in commissioning.anchors}
    if anchor_id not in anchors:
        raise SurveyError(f"the commissioning has no anchor {anchor_id}; it has {', '.join(anchors)}")
    changes = {
        pair: PairBaseline(value.range_mm - expected.range_mm, math.hypot(value.sigma_mm, expected.sigma_mm, FLOOR_MM))
        for pair, value in measured.items()
        if (expected := _expected(pair, anchors, before)) is not None
    }
    common = _common(
        {pair: change for pair, change in changes.items() if anchor_id not in pair}, kept=before is not None
    )
    own = {pair: change for pair, change in changes.items() if anchor_id in pair}
    if len(own) < MIN_NEIGHBOURS:
        heard = ", ".join(one if other == anchor_id else other for one, other in own) or "nobody"
        raise RadioError(f"the new node of {anchor_id} ranges {heard}; {MIN_NEIGHBOURS} neighbours are needed")
    weights = [1.0 / change.sigma_mm**2 for change in own.values()]
    delay = sum(w * (change.range_mm - common) for w, change in zip(weights, own.values(), strict=True)) / sum(weights)
    for pair, change in own.items():
        off, limit = abs(change.range_mm - common - delay), MOST_SIGMAS * math.hypot(change.sigma_mm, mount_mm)
        if off > limit:
            raise SurveyError(
                f"the range {pair[0]}-{pair[1]} differs from what the new node's other ranges say by {off:.0f} mm "
                f"({limit:.0f} mm would be chance): it does not stand where its predecessor did, or something is in "
                "the way; put it right, or commission the pad again"
            )
    if abs(delay) > MOST_DELAY_MM:
        raise SurveyError(
            f"the new node ranges {delay:+.0f} mm longer than its predecessor; set its antenna delay, or take another"
        )
    sigma = math.hypot(1.0 / math.sqrt(sum(weights)), mount_mm, 0.0 if before is not None else UNIT_MM)
    fresh = _anchor(anchors[anchor_id], delay, math.hypot(sigma, UNIT_MM), mount_mm)
    record = replace(
        commissioning,
        anchors=tuple(fresh if anchor.anchor_id == anchor_id else anchor for anchor in commissioning.anchors),
        valid_from_ms=now_ms,
        method=_method(commissioning.method, anchor_id, delay, len(own)),
    )
    kept = {} if before is None else {pair: value for pair, value in before.pairs.items() if anchor_id not in pair}
    baseline = Baseline(dict(measured) | kept, now_ms, f"node of {anchor_id} replaced")
    return Swapped(
        record,
        baseline,
        delay,
        sigma,
        max(abs(change.range_mm - common - delay) for change in own.values()),
        len(own),
        anchors[anchor_id].clock_sigma_mm is not None,
    )


def _expected(pair: Pair, anchors: Mapping[str, Anchor], before: Baseline | None) -> PairBaseline | None:
    """What a pair should measure: as at the commissioning, or as far as they stand apart."""
    if not {*pair} <= anchors.keys():
        return None
    if before is not None:
        return before.pairs.get(pair)
    one, other = (anchors[name] for name in pair)
    apart = math.dist((one.east_mm, one.north_mm, one.up_mm), (other.east_mm, other.north_mm, other.up_mm))
    return PairBaseline(apart, math.hypot(UNIT_MM, one.survey_sigma_mm, other.survey_sigma_mm))


def _common(others: Mapping[Pair, PairBaseline], *, kept: bool) -> float:
    """Change that the neighbours' ranges share. Raises SurveyError where theirs differ: then more than a node has."""
    if len(others) < MIN_NEIGHBOURS:
        text = "what they measured at the commissioning is kept" if kept else "they hear each other"
        raise RadioError(
            f"{len(others)} pairs of neighbours to compare with, {MIN_NEIGHBOURS} are needed: see that {text}"
        )
    common = median(change.range_mm for change in others.values())
    for pair, change in others.items():
        off = change.range_mm - common
        if abs(off) > MOST_SIGMAS * change.sigma_mm:
            raise SurveyError(
                f"the range {pair[0]}-{pair[1]} has changed by {off:+.0f} mm since the commissioning, and neither is "
                "the new node: an anchor was moved, or was replaced, too; commission the pad again"
            )
    return common


def _anchor(old: Anchor, delay_mm: float, sigma_mm: float, mount_mm: float) -> Anchor:
    bias = tuple(
        BiasPoint(
            range_mm=point.range_mm,
            bias_mm=round(point.bias_mm + delay_mm),
            sigma_mm=math.ceil(math.hypot(point.sigma_mm, sigma_mm)),
        )
        for point in old.bias
    )
    survey = math.ceil(math.hypot(old.survey_sigma_mm, mount_mm))
    return replace(old, bias=bias, survey_sigma_mm=survey, clock_offset_mm=None, clock_sigma_mm=None)


def _method(before: str, anchor_id: str, delay_mm: float, neighbours: int) -> str:
    word = f"; node of {anchor_id} replaced ({delay_mm:+.0f} mm, by {neighbours} neighbours)"
    return before[: _MAX_NOTE - len(word)] + word
