"""A drone's agent: one call proves the drone's location at a pad and does what the verdict permits.

Everything it needs is handed in (ledger, identity, node, position, callback), so that a simulator can run many in one
process and a companion computer runs one.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from wonderland.clock import Clock
from wonderland.proof_contract import AwayError, RefusedError
from wonderland.proofs import encoding, keys
from wonderland.proofs.encoding import from_base64url, to_base64url
from wonderland.proofs.errors import ProofError
from wonderland.proofs.prospects import hopeless
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Commissioning, Prekey
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.sessions import Claim, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.transcript import transcript_of
from wonderland.telemetry import StepName
from wonderland.uwb.agreed import no_plan, witness_plan
from wonderland.uwb.blinks import BlinkPlan
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_uav_agent.broadcasts import BroadcastSource, NoBroadcasts
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.position import PositionSource
from wonderland_uav_agent.session import events as on
from wonderland_uav_agent.session.machine import UavSession
from wonderland_uav_agent.session.ports import Act, Radio, UavLedger
from wonderland_uav_agent.session.runner import RangeListener, StepListener, UavRunner
from wonderland_uav_agent.session.timing import UavTiming
from wonderland_uav_agent.settings import WAIT_S

_log = logging.getLogger(__name__)
_Answer = TypeVar("_Answer")

REQUEST_ATTEMPTS: Final = 6
"""Another drone may take the same prekey at the same moment; then the next one is tried."""
TAKEN_PAUSE_S: Final = 0.05
"""Doubled with each attempt: a peer may be behind the one that listed the prekeys."""
AWAY_PAUSE_S: Final = 0.5
REQUEST_PATIENCE_S: Final = 15.0
"""How long a proof waits for a ledger that is away, before anything was sent and when it reads what was."""
COMMISSIONING_LOOKS: Final = 5
COMMISSIONING_PAUSE_S: Final = 0.4
"""The survey that the session rests on is on the ledger, but the peer that is asked may be behind."""
PREKEYS_LISTED: Final = 20
WITNESSED: Final = 4
"""Assurance that only a witness gives."""
_TAKEN: Final = frozenset({"PREKEY_USED", "PREKEY_UNKNOWN", "MVCC_READ_CONFLICT", "PHANTOM_READ_CONFLICT"})


@dataclass(frozen=True, slots=True)
class Urgency:
    """Why it should not have to wait, as it signs it with its request; ``low_battery`` has a figure."""

    priority: str | None = None
    battery_percent: int | None = None


CALM: Final = Urgency()
WAITED: Final = "queue_timeout"
"""How a pad ends a request whose turn did not come."""


class UavAgentError(Exception):
    """A proof could not begin: no position, no prekey, or a pad that is not in service. ``code`` is for machines."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


@dataclass(frozen=True, slots=True)
class ProofResult:
    """How a proof ended. ``state`` and ``end`` as on the ledger; ``steps``: step → ms since the epoch."""

    session_id: str
    uav_id: str
    pad_id: str
    action: str
    state: str
    end: str
    detail: str
    steps: dict[StepName, int]
    verdict: Verdict | None
    verdict_tx: str
    closing_tx: str


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request that is on the ledger, and the keys that follow from it."""

    session: Session
    pad_keys: keys.SessionKeys
    witness_keys: keys.SessionKeys | None


class UavAgent:
    """One drone. ``choose`` picks one of several prekeys; by default unpredictably.

    ``broadcasts``: what its Remote ID module sends, so that it can sign for it; without, it signs for none of it.
    ``on_range``: who finds the way down by the ranges; the node then ranges on until the drone has landed.
    """

    def __init__(
        self,
        *,
        uav_id: str,
        ledger: UavLedger,
        events: LedgerEvents,
        identity: Identity,
        signer: Signer,
        radio: Radio,
        position: PositionSource,
        act: Act,
        clock: Clock,
        broadcasts: BroadcastSource | None = None,
        timing: UavTiming | None = None,
        whole_certificate: bool = False,
        choose: Callable[[Sequence[Prekey]], Prekey] = secrets.choice,
        on_step: StepListener | None = None,
        on_range: RangeListener | None = None,
        patience_s: float = WAIT_S,
    ) -> None:
        self.uav_id: Final = uav_id
        self._ledger = ledger
        self._events = events
        self._identity = identity
        self._signer = signer
        self._radio = radio
        self._position = position
        self._broadcasts = broadcasts or NoBroadcasts()
        self._act = act
        self._clock = clock
        self._timing = timing or UavTiming()
        self._whole_certificate = whole_certificate
        self._choose = choose
        self._on_step = on_step
        self._on_range = on_range
        self._patience_s = patience_s
        self._runner: UavRunner | None = None

    def stop(self, reason: str = "drone_stopped") -> None:
        """End the session under way in a recorded state; ``prove`` returns soon after."""
        if self._runner is not None:
            self._runner.deliver(on.Interrupted(reason))

    def position(self) -> Claim | None:
        """Where the drone says that it is; None while it does not know."""
        return self._position.claim(self._clock())

    async def prove(self, pad_id: str, action: str, urgency: Urgency | None = None) -> ProofResult:
        """Ask the pad for a proof, take part in it, and act when it is granted.

        A pad that others use ends a request that waited for long; it is asked again, and the place in its queue kept,
        for as long as the drone has patience.

        Raises UavAgentError where no proof could begin, RefusedError where the contract refused the request, and
        AwayError where the ledger is away.
        """
        until_ms = self._clock() + round(1_000 * self._patience_s)
        while True:
            result = await self._prove_once(pad_id, action, urgency or CALM)
            if result.end != WAITED or self._clock() >= until_ms:
                return result
            _log.info(
                "%s: still waits for %s (%s); asks again", self.uav_id, pad_id, result.detail or "others are first"
            )

    async def _prove_once(self, pad_id: str, action: str, urgency: Urgency) -> ProofResult:
        commissioning = await self._commissioning(pad_id)
        node = await self._ability(pad_id)
        problem = no_plan(commissioning, node)
        if problem:
            raise UavAgentError("no_radio_plan", f"pad {pad_id}: {problem}")
        asked = await self._request(pad_id, action, node, urgency)
        session = asked.session
        _log.info("%s asks %s to %s: session %.12s", self.uav_id, pad_id, action, session.session_id)
        commissioning = await self._commissioning(pad_id, session.commissioning_sha256)
        mismatch = _mismatch(session, commissioning, self._identity, self._ledger.channel)
        if mismatch:
            await self._ledger.cancel(session.session_id, "session_mismatch", mismatch)
            raise UavAgentError("session_mismatch", f"the session on the ledger is not the one asked for: {mismatch}")
        doubt = hopeless(commissioning, session.policy, session.claim)
        if doubt:
            _log.warning("%s at %s: it will not be verified: %s", self.uav_id, pad_id, doubt)
        machine = UavSession(
            session,
            commissioning,
            asked.pad_keys,
            certificate=self._identity.certificate_der,
            claims=self._position.claim,
            now_ms=self._clock(),
            timing=self._timing,
            whole_certificate=self._whole_certificate,
            witness_blinks=await self._witness_blinks(asked),
            broadcasts=self._broadcasts.sent,
            measures=self._radio.measures,
            guided=self._on_range is not None and self._radio.measures,
        )
        runner = self._runner = UavRunner(
            machine,
            radio=self._radio,
            ledger=self._ledger,
            signer=self._signer,
            act=self._act,
            clock=self._clock,
            on_step=self._on_step,
            on_range=self._on_range,
        )
        self._events.listen(session.session_id, runner.deliver)
        try:
            finish = await runner.run()
        finally:
            self._events.forget(session.session_id)
            self._runner = None
        return ProofResult(
            session_id=session.session_id,
            uav_id=self.uav_id,
            pad_id=pad_id,
            action=action,
            state=finish.state,
            end=finish.end,
            detail=finish.detail,
            steps=dict(machine.steps),
            verdict=runner.verdict,
            verdict_tx=runner.verdict_tx,
            closing_tx=runner.completed_tx,
        )

    async def _ability(self, pad_id: str) -> NodeAbility | None:
        """What the drone's node can do, by what it says; nothing is asked for with one that no plan can use."""
        try:
            return await self._radio.ability()
        except RangingPlanError as error:
            raise UavAgentError("no_radio_plan", f"pad {pad_id}: {error}") from error

    async def _commissioning(self, pad_id: str, sha256: str = "") -> Commissioning:
        """The pad's survey; the one with that digest, if it is found in a while."""
        look = 0
        while True:
            look += 1
            pad = await self._patiently(lambda: self._ledger.read_pad(pad_id))
            if pad.commissioning is None:
                raise UavAgentError(
                    "pad_not_commissioned", f"pad {pad_id} has not been surveyed and proves nothing yet"
                )
            if sha256 in {"", pad.commissioning_sha256} or look == COMMISSIONING_LOOKS:
                return pad.commissioning
            await asyncio.sleep(COMMISSIONING_PAUSE_S)

    async def _witness_blinks(self, asked: _Asked) -> BlinkPlan | None:
        """The blinks for the session's witness, where it has one."""
        witness, witness_keys = asked.session.witness, asked.witness_keys
        if witness is None or witness_keys is None:
            return None
        commissioning = await self._commissioning(witness.pad_id, witness.commissioning_sha256)
        return witness_plan(witness_keys, commissioning, asked.session.node, payload=witness_keys.answer(b""))

    async def _witness_prekey(self, pad_id: str, action: str) -> Prekey | None:
        """A prekey of the witness that the policy names; None where it names none, or can do without."""
        policy = await self._ledger.read_policy(pad_id, action)
        if policy.witness_pad_id is None:
            return None
        prekeys = await self._ledger.list_prekeys(policy.witness_pad_id, PREKEYS_LISTED)
        if prekeys:
            return self._choose(prekeys)
        if policy.min_assurance >= WITNESSED:
            raise UavAgentError(
                "no_witness", f"pad {policy.witness_pad_id}, the witness, offers no prekey: its agent is not running"
            )
        return None

    async def _request(self, pad_id: str, action: str, node: NodeAbility | None, urgency: Urgency) -> _Asked:
        """Step 1, through a ledger that is away for a while, and other drones that take the same prekey."""
        attempts = 0
        while True:
            try:
                return await self._patiently(lambda: self._request_once(pad_id, action, node, urgency))
            except RefusedError as error:
                attempts += 1
                if error.code not in _TAKEN or attempts == REQUEST_ATTEMPTS:
                    raise
                await asyncio.sleep(TAKEN_PAUSE_S * 2**attempts)

    async def _patiently(self, ask: Callable[[], Awaitable[_Answer]]) -> _Answer:
        """What the ledger answers, through one that is away for a while. Raises `RefusedError` and `AwayError`."""
        loop = asyncio.get_running_loop()
        patient_until_s = loop.time() + REQUEST_PATIENCE_S
        while True:
            try:
                return await ask()
            except AwayError as error:
                # What may have been sent is not asked for twice: it would open a second session.
                if error.tx_id or loop.time() > patient_until_s:
                    raise
                _log.warning("the proof waits for the ledger: %s", error)
                await asyncio.sleep(AWAY_PAUSE_S)

    async def _request_once(self, pad_id: str, action: str, node: NodeAbility | None, urgency: Urgency) -> _Asked:
        prekeys, witness = await asyncio.gather(
            self._ledger.list_prekeys(pad_id, PREKEYS_LISTED), self._witness_prekey(pad_id, action)
        )
        if not prekeys:
            raise UavAgentError("no_prekey", f"pad {pad_id} offers no prekey: its agent is not running")
        claim = self._position.claim(self._clock())
        if claim is None:
            raise UavAgentError("no_position", "the position source has no fresh position")
        prekey = self._choose(prekeys)
        own = keys.new_key()
        argument = tx.RequestProof(
            pad_id=pad_id,
            action=action,
            prekey_id=prekey.prekey_id,
            uav_key=to_base64url(keys.public_bytes(own)),
            claim=claim,
            witness_prekey_id=None if witness is None else witness.prekey_id,
            node=node,
            priority=urgency.priority,
            battery_percent=urgency.battery_percent,
        )
        session, _ = await self._ledger.request_proof(argument)
        if (session.pad_key, session.uav_key) != (prekey.public_key, argument.uav_key):
            raise UavAgentError("session_mismatch", "the session on the ledger has other keys than the request")
        if session.node != node:
            raise UavAgentError("session_mismatch", "the session on the ledger has another node than the request")
        named = session.witness
        if (None if named is None else named.pad_key) != (None if witness is None else witness.public_key):
            raise UavAgentError("session_mismatch", "the session on the ledger has another witness than the request")
        digest = bytes.fromhex(session.transcript_sha256)

        def derived(public_key: str) -> keys.SessionKeys:
            return keys.derive(keys.shared_secret(own, from_base64url(public_key)), digest)

        return _Asked(session, derived(session.pad_key), None if named is None else derived(named.pad_key))


def _mismatch(session: Session, commissioning: Commissioning, identity: Identity, channel: str) -> str:
    """Why this is not the session that was asked for; empty where it is."""
    try:
        if encoding.digest(commissioning.to_json()).hex() != session.commissioning_sha256:
            return "it rests on another commissioning than the pad's"
    except ProofError as error:
        return str(error)
    if session.uav.certificate_sha256 != identity.certificate_sha256:
        return "it names another certificate than this drone's"
    if transcript_of(session, channel).digest().hex() != session.transcript_sha256:
        return "its transcript is not the one that follows from it"
    return ""
