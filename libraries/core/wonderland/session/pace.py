"""How much longer steps take where a session's blocks are long: everything that is said waits for a round."""

from __future__ import annotations

from typing import Final

from wonderland.uwb.layout import RangingPlan

USUAL_MS: Final = 50
"""Blocks up to this long are what the limits of a session are made for."""


def pace_of(plan: RangingPlan) -> float:
    """By what waits for rounds of this plan are to be multiplied; 1 where its blocks are no longer than usual."""
    return max(1.0, plan.interval_ms / USUAL_MS)
