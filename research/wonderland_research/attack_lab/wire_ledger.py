"""Attacks on the protocol, sent to a real ledger through the Gateway, with the certificates of who would send them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from wonderland.proof_contract import ProofContract, RefusedError
from wonderland.proofs import encoding, keys
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.sessions import Evidence, Radio, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.statement import statement
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.signing import raw_from_der

_LATER_S: Final = 0.05


@dataclass(frozen=True)
class Answer:
    """What the ledger said: a code of refusal, or a verdict."""

    attack: str
    outcome: str
    permission: str
    reasons: tuple[str, ...]

    @property
    def stopped(self) -> bool:
        """Whether nothing was won."""
        return self.permission != "granted" and self.outcome != "taken"


def _moved(evidence: Evidence, by_ms: int) -> Evidence:
    """The same rounds and claims, later; without what only their own session can have."""
    table = replace(evidence.ranges, t_ms=tuple(t_ms + by_ms for t_ms in evidence.ranges.t_ms))
    claims = tuple(replace(claim, t_ms=claim.t_ms + by_ms) for claim in evidence.claims)
    return replace(evidence, ranges=table, claims=claims, broadcast=(), time_stamps=None, clock=())


class LedgerAttacker:
    """Speaks for several members of a channel. ``drone`` and ``pad_id`` have had a session that was granted."""

    def __init__(self, connection: Connection, channel: Any, *, drone: str, pad_id: str) -> None:
        self._connection = connection
        self._channel = channel
        self._drone = drone
        self._pad_id = pad_id

    def _as(self, name: str) -> ProofContract:
        connection = self._connection
        gateway = Gateway(self._channel, connection.identity(name), connection.signer(name))
        return ProofContract(gateway.network(connection.channel), connection.chaincode)

    async def session(self, session_id: str) -> Session:
        """As the ledger has it."""
        return await self._as("mirror").read_session(session_id)

    async def all(self, session: Session, evidence: Evidence) -> list[Answer]:
        """Each attack once. ``session``, ``evidence``: of the session that was granted."""
        attacks: tuple[tuple[str, Callable[[], Awaitable[Verdict | None]]], ...] = (
            ("prekey-reuse", lambda: self._reuse(session)),
            ("many-sessions", lambda: self._replay(session, evidence, fresh=False)),
            ("evidence-replay", lambda: self._replay(session, evidence, fresh=True)),
            ("pad-alone", lambda: self._invent(session, evidence)),
            ("keyless-board", lambda: self._keyless(session, evidence)),
            ("wrong-role", lambda: self._decide_for_oneself(session, evidence)),
            ("decided-twice", lambda: self._again(session, evidence)),
        )
        return [await self._one(name, attack) for name, attack in attacks]

    async def _one(self, name: str, attack: Callable[[], Awaitable[Verdict | None]]) -> Answer:
        try:
            verdict = await attack()
        except RefusedError as refusal:
            return Answer(name, "not taken", "none", (refusal.code,))
        if verdict is None:
            return Answer(name, "taken", "none", ())
        return Answer(name, verdict.outcome, verdict.permission, tuple(reason.code for reason in verdict.reasons))

    async def _request(self, like: Session, prekey_id: str | None = None) -> Session:
        """A session of the drone; the pad's own agent is off, so that nobody else answers it."""
        if prekey_id is None:
            prekey_id = (await self._as(self._drone).list_prekeys(self._pad_id, 1))[0].prekey_id
        argument = tx.RequestProof(
            pad_id=self._pad_id,
            action=like.action,
            prekey_id=prekey_id,
            uav_key=encoding.to_base64url(keys.public_bytes(keys.new_key())),
            claim=replace(like.claim, t_ms=time.time_ns() // 1_000_000),
        )
        return (await self._as(self._drone).request_proof(argument))[0]

    async def _reuse(self, session: Session) -> Verdict | None:
        await self._request(session, session.prekey_id)
        return None

    async def _replay(self, session: Session, evidence: Evidence, *, fresh: bool) -> Verdict:
        other = await self._request(session)
        if fresh:
            evidence = _moved(evidence, other.requested_ms - session.requested_ms)
        return (await self._as(self._pad_id).submit_proof(other.session_id, evidence))[0]

    async def _invent(self, session: Session, evidence: Evidence) -> Verdict:
        unsigned = replace(evidence, uav_signature=None, broadcast=())
        other = await self._request(session)
        return (await self._as(self._pad_id).submit_proof(other.session_id, unsigned))[0]

    async def _keyless(self, session: Session, evidence: Evidence) -> Verdict:
        """Ranges of whichever board stands there, countersigned by a drone that is elsewhere."""
        other = await self._request(session)
        shown = _moved(evidence, other.requested_ms - session.requested_ms)
        # Rounds that are still to come are not fresh.
        await asyncio.sleep(max(shown.ranges.t_ms[-1] - time.time_ns() // 1_000_000, 0) / 1_000 + _LATER_S)
        said = statement(other.session_id, other.transcript_sha256, shown.ranges, shown.claims)
        signature = encoding.to_base64url(raw_from_der(self._connection.signer(self._drone)(said)))
        unbound = replace(shown, radio=Radio(measured_by="pad", sts="unbound"), uav_signature=signature)
        return (await self._as(self._pad_id).submit_proof(other.session_id, unbound))[0]

    async def _decide_for_oneself(self, session: Session, evidence: Evidence) -> Verdict:
        other = await self._request(session)
        return (await self._as(self._drone).submit_proof(other.session_id, evidence))[0]

    async def _again(self, session: Session, evidence: Evidence) -> Verdict:
        return (await self._as(self._pad_id).submit_proof(session.session_id, evidence))[0]
