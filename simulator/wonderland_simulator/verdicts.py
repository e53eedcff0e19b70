"""Verdicts as they become final: read from the ledger's blocks, the only place where a verdict is one."""

from __future__ import annotations

import time
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Any

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import STEP_NAMES, Evidence
from wonderland.proofs.records.transactions import SubmitProof
from wonderland.proofs.records.verdicts import Verdict
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway


@dataclass(frozen=True)
class CommittedVerdict:
    """One verdict with its transaction, the evidence that it rests on, and when this reader saw it (ms)."""

    verdict: Verdict
    evidence: Evidence
    tx_id: str
    block: int
    seen_ms: int

    @property
    def answer(self) -> str:
        """What the drone is told: the outcome, or ``unauthorised`` where only its papers are wanting."""
        if self.verdict.outcome == "verified" and not self.verdict.authorised:
            return "unauthorised"
        return self.verdict.outcome

    def step_ms(self) -> dict[str, int]:
        """Milliseconds that each step took: from the one before it, as the pad recorded them."""
        times = {step.step: step.t_ms for step in self.evidence.steps}
        times.setdefault("verdict", self.seen_ms)
        result: dict[str, int] = {}
        before: int | None = None
        for name in STEP_NAMES:
            t_ms = times.get(name)
            if t_ms is None:
                continue
            if before is not None:
                result[name] = max(0, t_ms - before)
            before = t_ms
        return result

    def line(self) -> dict[str, Any]:
        """One JSON object for machines; fields that a verdict does not have are left out."""
        verdict = self.verdict
        value: dict[str, Any] = {
            "drone": verdict.uav_id,
            "pad": verdict.pad_id,
            "action": verdict.action,
            "outcome": self.answer,
            "permission": verdict.permission,
            "rounds": verdict.rounds,
            "assurance": verdict.assurance,
            "reasons": [reason.code for reason in verdict.reasons],
            "transaction": self.tx_id,
            "session": verdict.session_id,
            "block": self.block,
            "steps_ms": self.step_ms(),
        }
        if verdict.signed is not None:
            value |= {
                "position": verdict.signed.outcome,
                "likelihood": verdict.signed.likelihood_ppm / 1e6,
                "error_m": verdict.signed.error_mm / 1000,
                "paper_rule": verdict.signed.paper_rule,
            }
        if verdict.broadcast is not None:
            value["broadcast"] = verdict.broadcast.outcome
            if verdict.broadcast.error_mm is not None:
                value["broadcast_error_m"] = verdict.broadcast.error_mm / 1000
        return value


async def committed(
    connection: Connection, channel: Any, *, identity: str = "mirror"
) -> AsyncGenerator[CommittedVerdict]:
    """Every verdict from now on, in order of the ledger; survives a restart of the ledger."""
    gateway = Gateway(channel, connection.identity(identity), connection.signer(identity))
    stream = await gateway.network(connection.channel).blocks(start_block=0, reconnect=True)
    async with stream:
        async for block in stream:
            for transaction in block.transactions:
                invocation = transaction.invocation
                if not transaction.is_valid or invocation is None or invocation.function != "SubmitProof":
                    continue
                try:
                    evidence = SubmitProof.decode(invocation.args[1]).evidence
                    verdict = Verdict.parse(encoding.decode(invocation.response.payload))
                except (ProofError, IndexError):
                    continue  # another contract's function of the same name
                yield CommittedVerdict(verdict, evidence, transaction.tx_id, block.number, time.time_ns() // 1_000_000)
