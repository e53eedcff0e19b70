"""What is known of DW1000 anchors before anybody calibrated them: the chip's bias curve, and how far units differ.

A commissioning starts from here: what a run does not teach stays as it is without one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame

SIGMA_MM: Final = 40
BIAS_M: Final = ((0.0, 0.0), (8.0, 0.0), (16.0, 0.08), (30.0, 0.14), (100.0, 0.16))
"""Typical mean error by distance. Installations differ from it by several centimetres, hence the next two."""
BIAS_SIGMA_MM: Final = 45
INSTALLATION_MM: Final = 60
MAX_RANGE_MM: Final = 100_000
METHOD: Final = "DW1000 bias curve from published measurements; not calibrated"


def chip_commissioning(
    frame: Frame, anchors: Iterable[Anchor], *, valid_from_ms: int, valid_until_ms: int
) -> Commissioning:
    """The record of anchors (their own bias tables do not count) that nobody calibrated."""
    bias = tuple(
        BiasPoint(range_mm=round(distance * 1000), bias_mm=round(value * 1000), sigma_mm=BIAS_SIGMA_MM)
        for distance, value in BIAS_M
    )
    return Commissioning(
        frame=frame,
        anchors=tuple(replace(anchor, bias=bias) for anchor in anchors),
        range_sigma_mm=SIGMA_MM,
        installation_sigma_mm=INSTALLATION_MM,
        max_range_mm=MAX_RANGE_MM,
        valid_from_ms=valid_from_ms,
        valid_until_ms=valid_until_ms,
        method=METHOD,
    )
