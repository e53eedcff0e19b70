"""A proof's result for people, and for programs."""

from __future__ import annotations

from typing import Any, Final

from wonderland import messages
from wonderland.proof_contract import MAX_NOTE
from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland.telemetry import clean
from wonderland_uav_agent.agent import ProofResult

_ENDS: Final = "console/end"


def document(result: ProofResult) -> dict[str, Any]:
    """For ``--json``."""
    return {
        "session_id": result.session_id,
        "uav_id": result.uav_id,
        "pad_id": result.pad_id,
        "action": result.action,
        "state": result.state,
        "end": result.end,
        "detail": result.detail,
        "outcome": result.verdict.outcome if result.verdict is not None else None,
        "permission": result.verdict.permission if result.verdict is not None else None,
        "verdict": result.verdict.to_json() if result.verdict is not None else None,
        "verdict_tx": result.verdict_tx,
        "closing_tx": result.closing_tx,
        "steps": [{"step": step, "t_ms": result.steps[step]} for step in STEP_NAMES if step in result.steps],
    }


def lines(result: ProofResult) -> list[str]:
    """In words: the outcome, and below it each reason."""
    verdict = result.verdict
    if verdict is None:
        return [_no_verdict(result)]
    outcome = f"{verdict.outcome.capitalize()} with assurance {verdict.assurance}"
    said = [f"{outcome}, permission {verdict.permission} (session {result.session_id[:12]}…)"]
    return said + [f"  {messages.text('reasons', reason.code, reason.facts)}" for reason in verdict.reasons]


def why_not(result: ProofResult) -> str:
    """Why nothing was permitted, in one line; empty where something was."""
    verdict = result.verdict
    if verdict is None:
        return _no_verdict(result)
    if verdict.permission == "granted":
        return ""
    reasons = (messages.text("reasons", reason.code, reason.facts) for reason in verdict.reasons)
    return f"{verdict.outcome}: {' '.join(reasons)}"


def _no_verdict(result: ProofResult) -> str:
    """Why there is none: the catalogue's words for the end, and what whoever ended it wrote beside it."""
    known = result.end in messages.keys_of(_ENDS)
    words = messages.text(_ENDS, result.end, {}) if known else result.end.replace("_", " ")
    detail = clean(result.detail, MAX_NOTE).rstrip(".")
    stop = "" if detail.endswith(("?", "!")) else "."
    return f"No verdict: {words}." + (f" {detail[:1].upper()}{detail[1:]}{stop}" if detail else "")
