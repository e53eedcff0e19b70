"""Windows of recorded ranges handed to the contract's own function, without radios and without a ledger.

A window counts as countersigned and authorised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from wonderland.proofs import frame as frames
from wonderland.proofs.errors import GeometryError, ProofError
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import (
    MAX_CLAIMS,
    NO_RANGE,
    AnchorRanges,
    Claim,
    Evidence,
    Party,
    Radio,
    RangeTable,
    Session,
)
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.verdict import preview
from wonderland_edge_agent.commissioning.errors import RecordingError
from wonderland_edge_agent.commissioning.recording import Point

START_MS: Final = 1_800_000_000_000
"""A recording has no date; a fixed one makes its verdicts repeatable."""
SESSION_MS: Final = 3_600_000
CLAIM_ACCURACY_MM: Final = 100
CLAIM_HEIGHT_ACCURACY_MM: Final = 200
FARTHEST_CLAIM_M: Final = 1e8
LONGEST_RANGE_MM: Final = 1_000_000


@dataclass(frozen=True)
class Prepared:
    """What the contract would be given about a window, were the drone to countersign."""

    session: Session
    commissioning: Commissioning
    evidence: Evidence

    def verdict(self) -> Verdict:
        """The contract's own function on it."""
        return preview(self.session, self.commissioning, self.evidence, self.evidence.ranges.t_ms[-1])


def prepare(
    times_s: Sequence[float],
    ranges_m: Sequence[Mapping[str, float]],
    claimed_m: Sequence[Point],
    commissioning: Commissioning,
    policy: Policy,
) -> Prepared:
    """Session and evidence of consecutive rounds, and what the drone says in each. Raises RecordingError."""
    origin_s = times_s[0]
    times = [START_MS + round((t_s - origin_s) * 1000) for t_s in times_s]
    try:
        claims = [_claim(commissioning, t_ms, place) for t_ms, place in zip(times, claimed_m, strict=True)]
        table = RangeTable(
            t_ms=tuple(times),
            anchors=tuple(
                AnchorRanges(
                    anchor_id=anchor.anchor_id,
                    range_mm=tuple(_range_mm(item.get(anchor.anchor_id)) for item in ranges_m),
                )
                for anchor in commissioning.anchors
            ),
        )
    except ProofError as error:
        raise RecordingError(f"at {origin_s:.3f} s: {error}") from error
    every = -(-len(claims) // (MAX_CLAIMS - 1))
    chosen = claims[::every] if (len(claims) - 1) % every == 0 else [*claims[::every], claims[-1]]
    evidence = Evidence(
        ranges=table,
        claims=tuple(chosen),
        broadcast=(),
        matched="both",
        radio=Radio(measured_by="pad", sts="provisioned"),
        steps=(),
    )
    return Prepared(_session(claims[0], policy), commissioning, evidence)


def _claim(commissioning: Commissioning, t_ms: int, place_m: Point) -> Claim:
    if not all(abs(value) <= FARTHEST_CLAIM_M for value in place_m):
        raise GeometryError(
            f"a claim at {place_m[0]:g}, {place_m[1]:g}, {place_m[2]:g} m is nowhere on Earth (--claim, --truth-raise)"
        )
    east, north, up = (round(value * 1000) for value in place_m)
    frame = commissioning.frame
    try:
        lat_e7, lon_e7, height_mm = frames.to_wgs84(frame, east, north, up)
    except GeometryError:
        # Beyond the frame's reach one place is as far as another: the other side of the planet stands for all.
        lat_e7, lon_e7, height_mm = -frame.lat_e7, frame.lon_e7, frame.height_mm
    return Claim(
        lat_e7=lat_e7,
        lon_e7=lon_e7,
        height_mm=height_mm,
        accuracy_mm=CLAIM_ACCURACY_MM,
        height_accuracy_mm=CLAIM_HEIGHT_ACCURACY_MM,
        t_ms=t_ms,
    )


def _range_mm(range_m: float | None) -> int:
    """As UCI reports it, in whole centimetres; what is no range a node could report counts as none."""
    if range_m is None or not 0.0 < range_m * 1000 < LONGEST_RANGE_MM:
        return NO_RANGE
    return round(range_m * 100) * 10


def _session(claim: Claim, policy: Policy) -> Session:
    party = Party(msp_id="PadMSP", certificate_sha256="0" * 64)
    return Session(
        session_id="0" * 64,
        state="requested",
        pad_id="recording",
        uav_id="RECORDED",
        action="land",
        claim=claim,
        prekey_id="none",
        pad_key="A" * 87,
        uav_key="A" * 87,
        pad=party,
        uav=party,
        commissioning_sha256="0" * 64,
        contract_version="0",
        transcript_sha256="0" * 64,
        policy=policy,
        requested_ms=START_MS,
        expires_ms=START_MS + SESSION_MS,
    )
