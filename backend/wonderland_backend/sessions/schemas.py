"""Shapes of sessions."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland.proofs.records import sessions
from wonderland_backend.ledger.schemas import LedgerTransaction
from wonderland_backend.schemas import ApiModel, model_of, page_of
from wonderland_backend.tracks.schemas import Estimate, Finding, SessionSignature
from wonderland_backend.verdicts.schemas import VerdictSummary

StepName = Literal["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]


class Step(ApiModel):
    """One of the eight steps. Those of source `ledger` are committed; the others are an agent's word."""

    step: StepName
    t_ms: int
    ok: bool
    detail: str | None = None
    source: Literal["ledger", "pad", "uav"]


class SessionSummary(ApiModel):
    """A session as lists and the live map show it."""

    session_id: str
    pad_id: str
    uav_id: str
    action: Literal["land", "takeoff", "dock"]
    state: Literal["requested", "decided", "completed", "cancelled"]
    requested_ms: int
    expires_ms: int
    decided_ms: int | None = None
    ended_ms: int | None = None
    steps: list[Step]
    request_tx: str
    verdict_tx: str | None = None
    complete_tx: str | None = Field(default=None, description="The transaction that ended it, done or cancelled")
    outcome: Literal["verified", "refuted", "inconclusive"] | None = None
    permission: Literal["granted", "refused"] | None = None
    rounds: int | None = None
    end: str | None = None


class ReportedEnd(ApiModel):
    """How an agent says that the session ended. Not from the ledger."""

    source: Literal["pad", "uav"]
    t_ms: int
    state: str
    end: str | None = None
    tx_id: str | None = None
    signature: SessionSignature | None = None
    verified: Literal[False]


class SessionDetail(ApiModel):
    """All that is known of a session."""

    summary: SessionSummary
    session: model_of(sessions.Session)  # type: ignore[valid-type]
    verdict: VerdictSummary | None = None  # type: ignore[valid-type]
    evidence: model_of(sessions.Evidence) | None = Field(  # type: ignore[valid-type]
        default=None, description="What the pad brought before the contract"
    )
    transactions: list[LedgerTransaction] = Field(description="The session's transactions, oldest first")
    estimates: list[Estimate] = Field(description="Running estimates of the pad, oldest first; unverified")
    reported_ends: list[ReportedEnd]
    signature: SessionSignature | None = Field(
        default=None,
        description="Who said it: from the session's own pad, once it ended. Whether it is true: `verdict`",
    )
    findings: list[Finding] = Field(
        description="What was odd about the drone's broadcasts, oldest first; unverified, no part of the verdict"
    )


class CourseClaim(ApiModel):
    """One claim at one look."""

    likelihood_ppm: int = Field(description="That the drone is within the buffer of this claim")
    error_mm: int = Field(description="Between the claim and the estimate")


class CoursePoint(ApiModel):
    """The decision on what had been measured after so many rounds. Only the last one stands on the ledger."""

    rounds: int
    t_ms: int
    outcome: Literal["verified", "refuted", "inconclusive"]
    signed: CourseClaim | None = None
    broadcast: CourseClaim | None = None


class AnchorResiduals(ApiModel):
    """One anchor's ranges, corrected by its bias, against where the drone would have been: positive is too far."""

    anchor_id: str
    t_ms: list[int] = Field(description="Of the usable rounds in which it measured")
    claim_mm: list[int] = Field(description="Measured minus what the signed claim of that moment would give")
    estimate_mm: list[int] | None = Field(default=None, description="The same for the estimate")
    sigma_mm: int = Field(description="Standard deviation of one range as the pad was commissioned")


class Course(ApiModel):
    """How a session's decision came about, recomputed from its evidence with the contract's own function."""

    verify_ppm: int = Field(description="From this likelihood on a claim is verified")
    refute_ppm: int = Field(description="Up to this one it can be refuted")
    points: list[CoursePoint] = Field(description="By rounds; the last one is the verdict")
    residuals: list[AnchorResiduals] = Field(description="By anchor; empty where the pad's survey is not known")


SessionPage = page_of("SessionPage", SessionSummary)
