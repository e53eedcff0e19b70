"""Shapes of verdicts."""

from __future__ import annotations

from pydantic import Field

from wonderland.proofs.records import verdicts
from wonderland_backend.schemas import extended, page_of

VerdictSummary = extended(
    "VerdictSummary",
    verdicts.Verdict,
    "The contract's verdict, and the transaction that it stands in.",
    tx_id=(str, ...),
    block=(int, ...),
    tx_index=(int, Field(description="Index of the transaction in its block")),
)
VerdictPage = page_of("VerdictPage", VerdictSummary)
