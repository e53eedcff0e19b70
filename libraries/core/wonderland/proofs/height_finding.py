"""What the measured height means for a verdict, for its estimate and for its words: part of steps 8 and 10."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wonderland.proofs.judgement import Measured, place
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.reasons import Reasons, milli, nearest, reason
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.verdicts import Covariance, HeightFinding, Judgement, Position, Reason
from wonderland.proofs.reduction import said_at
from wonderland.proofs.vertical import Vertical

_FRAME_MM: Final = 19_999_999.0
_LARGEST_MM2: Final = float(2**52)


def hold_height(signed: Judgement, height: Vertical | None, policy: Policy, *, may_refute: bool) -> Judgement:
    """The judgement of the signed claim, with its height: refuted by it, or held back for it, or as it was."""
    if height is not None and height.outcome == "contradicted" and may_refute:
        if signed.outcome == "refuted":
            return signed
        off, tolerance = nearest(height.solid.up), nearest(height.tolerance_mm)
        return _with(signed, "refuted", reason("height_contradicts", off_mm=off, tolerance_mm=tolerance))
    if signed.outcome != "verified":
        return signed
    if height is not None and height.doubted:
        return _with(signed, "inconclusive", reason("height_doubted", off_mm=nearest(height.solid.up)))
    if policy.height_required and (height is None or height.outcome != "proved"):
        geometry = "tells_nothing" if height is None else "leaves_open"
        return _with(signed, "inconclusive", reason("height_not_proved", geometry=geometry))
    return signed


def _with(signed: Judgement, outcome: str, why: Reason) -> Judgement:
    return replace(signed, outcome=outcome, reasons=(*signed.reasons, why))


def say_height(height: Vertical | None, policy: Policy, reasons: Reasons) -> None:
    """Of a verified place: whether its height is proved, or the drone's word."""
    if height is None:
        reasons.add("height_claimed")
    elif height.outcome == "proved":
        reasons.add("height_proved", off_mm=nearest(abs(height.solid.up)), buffer_mm=policy.height_buffer_mm)
    else:
        reasons.add("height_open", lowest_mm=nearest(height.low), highest_mm=nearest(height.high))


def height_record(height: Vertical | None, measured: Measured | None) -> HeightFinding | None:
    """The finding as the ledger has it."""
    if height is None or measured is None:
        return None
    up, solid = said_at(measured.reduced).up, height.solid
    return HeightFinding(
        outcome=height.outcome,
        claimed_mm=_in_frame(up),
        measured_mm=_in_frame(up + solid.up),
        lowest_mm=_in_frame(up + height.low),
        highest_mm=_in_frame(up + height.high),
        tolerance_mm=min(int(height.tolerance_mm), 100_000_000),
        likelihood_ppm=height.likelihood_ppm,
        uu_mm2=_mm2(solid.uu),
        eu_mm2=_mm2(solid.eu),
        nu_mm2=_mm2(solid.nu),
        chi2_milli=milli(solid.chi2),
    )


def estimate(
    commissioning: Commissioning, measured: Measured, height: Vertical | None
) -> tuple[Position, Covariance, int]:
    """(place, horizontal covariance, χ² × 1000) of the drone at ``said_at``.

    At the claimed height, unless that is measured: then at the measured one; and where the claimed one is
    contradicted, the whole place is the one of three dimensions, since that on the map believed the claim.
    """
    said, offset = said_at(measured.reduced), measured.offset
    east, north, up, covariance, chi2 = offset.east, offset.north, 0.0, offset.covariance, offset.chi2
    if height is not None and height.outcome != "claimed":
        up = height.solid.up
    if height is not None and height.outcome == "contradicted":
        east, north = height.solid.east, height.solid.north
        covariance, chi2 = height.solid.horizontal, height.solid.chi2
    spread = measured.reduced.moment_spread
    where = place(commissioning, said.east + east, said.north + north, said.up + up)
    return where, _covariance(covariance if spread is None else covariance + spread), milli(chi2)


def _covariance(matrix: Matrix2) -> Covariance:
    return Covariance(ee_mm2=_mm2(matrix.ee), en_mm2=_mm2(matrix.en), nn_mm2=_mm2(matrix.nn))


def _mm2(value: float) -> int:
    return nearest(max(-_LARGEST_MM2, min(_LARGEST_MM2, value)))


def _in_frame(up_mm: float) -> int:
    return nearest(max(-_FRAME_MM, min(_FRAME_MM, up_mm)))
