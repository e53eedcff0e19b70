"""Reasons: a code for machines and the facts that belong to it. Their words are at the edges (`wonderland.messages`).

Nothing that endorsers agree on is a sentence, so that no rewording changes it. Units are in the facts' names: `_mm`,
`_ms`, `_percent`, `_milli` (thousandths), `_ids` (names, with commas between them); all others are counts, ids or one
of a few words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from wonderland.proofs.records.verdicts import Reason

_STAMPS: Final[Mapping[str, tuple[str, ...]]] = {
    "unbound": (),
    "inconsistent": ("chi2_milli", "limit_milli"),
    "disagree": (),
    "vague": ("frames", "sigma_mm", "more_frames"),
    "prove": ("frames",),
}
"""What the time stamps of the pad's anchors come to, and those of a witness, each with its prefix."""

REASONS: Final[Mapping[str, tuple[str, ...]]] = {
    # Fresh, of this drone, plausible by itself (steps 1, 2 and 4).
    "rounds_not_fresh": (),
    "frames_not_fresh": (),
    "claims_not_fresh": (),
    "claims_go_back": (),
    "time_goes_back": (),
    "claim_far_away": (),
    "claim_vague": ("accuracy_mm",),
    "claim_height_vague": ("accuracy_mm",),
    "claims_jump": ("jump_mm",),
    "clock_contradicts": (),
    "clock_off": ("off_ms", "away_mm"),
    "codes_not_matched": (),
    "not_countersigned": (),
    "countersignature_invalid": (),
    "session_stopped": ("failure",),
    # Which rounds and anchors serve (steps 3 and 6).
    "pad_drifts": ("sigma_mm",),
    "calibrated": ("offset_mm", "sigma_mm"),
    "calibration_alone": ("offset_mm",),
    "too_few_rounds": ("rounds", "min_rounds"),
    "rounds_missing": ("attempted", "whole"),
    "obstructed": ("ranges",),
    "anchors_unknown": ("anchors",),
    "anchor_silent": ("silent", "anchors"),
    "anchor_rarely": ("anchor_id",),
    # The place that the ranges give, and whether they agree (step 5; what was claimed, step 8).
    "no_estimate": ("lacking",),
    "ranges_inconsistent": ("chi2_milli", "limit_milli"),
    "anchor_suspected": ("anchor_ids", "anchors"),
    "mirror_ambiguity": (),
    "bursts": ("ranges",),
    "unchecked": (),
    "claims_torn": ("torn", "rounds"),
    "rounds_vague": ("rounds",),
    "claims_unseen": ("share_percent",),
    "one_claim": (),
    "claims_unjudged": ("claims", "away_mm"),
    "request_unjudged": ("away_mm", "before_ms"),
    # Time stamps (step 7).
    "no_time_stamps": (),
    "no_witness": (),
    **{f"time_differences_{name}": facts for name, facts in _STAMPS.items()},
    **{f"witness_{name}": facts for name, facts in _STAMPS.items()},
    "clock_suspected": ("stamps_of", "anchor_ids", "anchors"),
    "time_differences_contradict": ("significance_milli",),
    "witness_contradicts": ("frames", "significance_milli"),
    "measurements_contradict": (),
    "ranges_unbound": ("measured_by",),
    "assurance_too_low": ("assurance", "min_assurance"),
    # The claim against the measurement (steps 8 to 10).
    "within_buffer": ("error_mm", "buffer_mm"),
    "outside_buffer": ("error_mm", "buffer_mm", "significance_milli"),
    "cannot_refute": (),
    "undecided": ("error_mm", "sigma_mm"),
    "claims_waver": ("waver_mm",),
    "leaving": ("rounds", "away_mm"),
    "drifting": ("rounds", "away_mm"),
    "cannot_settle": (),
    "upper_bound": ("within_mm",),
    "height_claimed": (),
    "height_open": ("lowest_mm", "highest_mm"),
    "height_proved": ("off_mm", "buffer_mm"),
    "height_contradicts": ("off_mm", "tolerance_mm"),
    "height_doubted": ("off_mm",),
    "height_not_proved": ("geometry",),
    "broadcast_own_contradicts": ("error_mm",),
    "broadcast_contradicts": ("error_mm",),
    "broadcast_undecided": ("error_mm", "tolerance_mm"),
    "broadcast_not_heard": (),
    "broadcast_unsupported": (),
    # Whether it may (the contract).
    "uav_suspended": (),
    "uav_retired": (),
    "maintenance_missing": (),
    "maintenance_lapsed": ("until_ms",),
    "not_authorised": ("action", "pad_id"),
    "closures_outdated": ("pad_id", "until_ms"),
    "zone_active": ("zone_id", "action", "pad_id"),
}
"""Every code with the names of its facts, all of which it has."""
_LARGEST: Final = float(2**53 - 1)
_LARGEST_FIGURE: Final = 1e12
"""Figures beyond these are said as these."""


def reason(code: str, **facts: int | str) -> Reason:
    """Why. Raises ValueError where the code is not in `REASONS`, or its facts are others."""
    if tuple(facts) != REASONS.get(code):
        raise ValueError(f"{code} with the facts {', '.join(facts) or 'none'}: not what REASONS says")
    return Reason(code=code, facts=facts)


@dataclass
class Reasons:
    """Collects why, in the order of the steps."""

    items: list[Reason] = field(default_factory=list)

    def add(self, code: str, **facts: int | str) -> None:
        """Add a reason. Raises ValueError for a code or facts that REASONS does not have."""
        self.items.append(reason(code, **facts))


def nearest(value: float) -> int:
    """The nearest integer, halves away from zero."""
    size = int(min(abs(value), _LARGEST) + 0.5)
    return size if value >= 0.0 else -size


def milli(value: float) -> int:
    """Thousandths, for a fact."""
    return nearest(min(value, _LARGEST_FIGURE) * 1000.0)
