"""A pad that says of itself that it is no longer quite as commissioned: it may only make itself vaguer."""

from __future__ import annotations

from dataclasses import replace
from math import isqrt
from typing import Final

from wonderland.proofs.records.pads import Commissioning

MAX_SIGMA_MM: Final = 10_000
"""As ``Anchor.survey_sigma_mm`` holds."""


def widened(commissioning: Commissioning, drift_sigma_mm: int) -> Commissioning:
    """The commissioning with this uncertainty added, in quadrature, to where each anchor stands; never taken away."""
    added = drift_sigma_mm * drift_sigma_mm
    return replace(
        commissioning,
        anchors=tuple(
            replace(
                anchor,
                survey_sigma_mm=min(isqrt(anchor.survey_sigma_mm * anchor.survey_sigma_mm + added), MAX_SIGMA_MM),
            )
            for anchor in commissioning.anchors
        ),
    )
