"""The verdict: what the contract decided, on what ground, and what it cannot exclude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.records.fields import (
    Action,
    HeightMm,
    LatE7,
    LocalMm,
    LonE7,
    PadId,
    Ppm,
    SessionId,
    Sha256Hex,
    TimeMs,
    UavId,
)
from wonderland.proofs.records.schema import Choice, Facts, Integer, Items, Record, Text
from wonderland.proofs.records.sessions import MAX_CLAIMS

OUTCOMES = ("verified", "refuted", "inconclusive")
Outcome = Annotated[str, Choice(OUTCOMES)]
Mm = Annotated[int, Integer(0, 100_000_000, "Millimetres")]
Mm2 = Annotated[int, Integer(-(2**52), 2**52, "Square millimetres")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Reason(Record):
    """Why: a code, and the facts that belong to it (`wonderland.proofs.reasons`); words for it are at the edges."""

    code: Annotated[str, Text(48, r"[a-z0-9_]+")]
    facts: Annotated[Mapping[str, int | str], Facts(description="Units end their names: _mm, _ms, _percent, _milli")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Position(Record):
    """A point in the pad's frame and on the globe."""

    east_mm: LocalMm
    north_mm: LocalMm
    up_mm: LocalMm
    lat_e7: LatE7
    lon_e7: LonE7
    height_mm: HeightMm


@dataclass(frozen=True, kw_only=True, slots=True)
class Covariance(Record):
    """Of the estimate, horizontal: east-east, east-north, north-north."""

    ee_mm2: Mm2
    en_mm2: Mm2
    nn_mm2: Mm2


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement(Record):
    """One claim, judged: where it is, how far the estimate lies from it, how likely it holds."""

    outcome: Outcome
    claim: Position
    error_mm: Mm
    likelihood_ppm: Ppm
    paper_rule: bool
    reasons: Annotated[tuple[Reason, ...], Items(0, 32)]


BROADCAST_OUTCOMES = ("supported", "contradicted", "own_contradicted", "undecided", "not_heard")


@dataclass(frozen=True, kw_only=True, slots=True)
class BroadcastFinding(Record):
    """What was heard under the drone's serial number on Remote ID, against what was measured.

    Anybody can broadcast any serial number: ``contradicted`` says that somebody did, ``own_contradicted`` that the
    drone signed for the message. The last four are of the message that decides, in the sense of ``outcome``.
    """

    outcome: Annotated[
        str,
        Choice(
            BROADCAST_OUTCOMES,
            "The measurement supports it; contradicts a message of unknown origin; contradicts one that the drone "
            "attested; neither yet; or nothing was heard near the session's claims",
        ),
    ]
    messages: Annotated[int, Integer(0, MAX_CLAIMS, "Heard near the session's claims, and judged")]
    attributed: Annotated[int, Integer(0, MAX_CLAIMS, "Of these, attested by the drone's countersignature")]
    supported: bool
    """Whether what was heard beside its claims supports the drone: all that it attested, or any where none is."""
    claim: Position | None = None
    error_mm: Mm | None = None
    likelihood_ppm: Ppm | None = None
    tolerance_mm: (
        Annotated[int, Integer(0, 100_000_000, "Judged within this, for its stated accuracy and its age")] | None
    ) = None


HEIGHT_OUTCOMES = ("proved", "contradicted", "claimed")


@dataclass(frozen=True, kw_only=True, slots=True)
class HeightFinding(Record):
    """What the ranges say of the claimed height; where their geometry says nothing of it there is no finding."""

    outcome: Annotated[
        str,
        Choice(
            HEIGHT_OUTCOMES,
            "The ranges prove it within the policy's height buffer; or prove that it is another; or neither: it is "
            "the drone's word, and the interval is what is left open",
        ),
    ]
    claimed_mm: LocalMm
    """Mean claimed height above the pad's origin."""
    measured_mm: LocalMm
    """The height that fits the ranges best."""
    lowest_mm: LocalMm
    highest_mm: LocalMm
    """The ranges leave what is between these open (three standard deviations, mirrored places included)."""
    tolerance_mm: Annotated[
        int, Integer(0, 100_000_000, "Contradicted beyond this: the height buffer, or twice the accuracy it stated")
    ]
    likelihood_ppm: Ppm
    """That it is within the height buffer of its claim."""
    uu_mm2: Mm2
    eu_mm2: Mm2
    nu_mm2: Mm2
    """Covariance of the estimate in three dimensions: up-up, east-up, north-up."""
    chi2_milli: Annotated[int, Integer(0, 2**52, "χ² of the ranges about that estimate × 1000")]


TIMED = ("inside", "outside", "vague", "inconsistent")


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeDifferences(Record):
    """What the time stamps of the drone's frames prove without any word of its clock."""

    pad_id: PadId
    frames: Annotated[int, Integer(0, 500, "Frames that all of the anchors heard")]
    finding: Annotated[
        str,
        Choice(
            TIMED,
            "Alone they prove the drone within the buffer, or outside of it, or neither; or contradict one another",
        ),
    ]
    agrees: bool
    """Whether one place explains them and the two-way ranges."""
    more_frames: Annotated[int, Integer(-1, 10_000, "Further frames expected to prove it inside; −1: none would")]
    error_mm: Mm | None = None
    likelihood_ppm: Ppm | None = None
    covariance: Covariance | None = None
    chi2_milli: Annotated[int, Integer(0, 2**52, "χ² of the differences about their estimate × 1000")] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class DroneClock(Record):
    """The drone's clock against the pad's: how far ahead it is, and how well the echoes tell."""

    offset_ms: Annotated[int, Integer(-(2**40), 2**40, "The drone's clock minus the pad's; claims were shifted by it")]
    sigma_ms: Annotated[int, Integer(0, 2**31, "Standard deviation of what is left")]
    readings: Annotated[int, Integer(0, 16)]


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict(Record):
    """The contract's decision about a session."""

    session_id: SessionId
    pad_id: PadId
    uav_id: UavId
    action: Action
    outcome: Outcome
    permission: Annotated[str, Choice(("granted", "refused"))]
    authorised: bool
    assurance: Annotated[int, Integer(0, 4)]
    rounds: Annotated[int, Integer(0, 500, "Usable rounds")]
    buffer_mm: Mm
    decided_ms: TimeMs
    evidence_sha256: Sha256Hex
    reasons: Annotated[tuple[Reason, ...], Items(0, 64)]
    more_rounds: Annotated[int, Integer(-1, 10_000, "Further rounds expected to settle it; −1: none would")]
    signed: Judgement | None = None
    broadcast: BroadcastFinding | None = None
    estimate: Position | None = None
    estimate_ms: TimeMs | None = None
    """The moment at which the drone was at the estimate: the mean time of the rounds that it rests on."""
    covariance: Covariance | None = None
    height: HeightFinding | None = None
    chi2_milli: Annotated[int, Integer(0, 2**52, "χ² of the ranges about the estimate × 1000")] | None = None
    chi2_claim_milli: Annotated[int, Integer(0, 2**52, "χ² of the ranges about the claim × 1000")] | None = None
    within_mm: (
        Annotated[
            int, Integer(0, 100_000_000, "With upper_bound: all that is proved is within this distance of the pad")
        ]
        | None
    ) = None
    time_differences: TimeDifferences | None = None
    witness: TimeDifferences | None = None
    clock: DroneClock | None = None
