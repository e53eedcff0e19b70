"""The pad's agent: requests from the ledger in, one session at a time, everything told and ended.

``PadAgent`` puts the parts together and keeps them going; each part stands alone: ``session`` (the eight steps),
``radios``, ``receiver``, ``prekeys``, ``reconcile``, ``spool``.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from wonderland import telemetry
from wonderland.clock import SteadyClock
from wonderland.proof_contract import AwayError, ContractEvent, RefusedError
from wonderland.proofs import keys
from wonderland.proofs.encoding import from_base64url
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Session
from wonderland.telemetry import Health
from wonderland_edge_agent.ability import Now, goes_on_without, not_for, not_known, why_not
from wonderland_edge_agent.admission import Admission, NotAdmitted
from wonderland_edge_agent.assurance import beyond_here
from wonderland_edge_agent.drift.idle import watch_when_idle
from wonderland_edge_agent.event_subscription import EventSubscription
from wonderland_edge_agent.health import health_record, reach_of, tell_health, write_status
from wonderland_edge_agent.metrics import write_metrics
from wonderland_edge_agent.own_pad import OwnPad
from wonderland_edge_agent.ports import PadLedger, PadRadiosPort
from wonderland_edge_agent.prekeys import PrekeyKeeper
from wonderland_edge_agent.radios.roll_calls import call_when_idle
from wonderland_edge_agent.reconcile import Reconciler
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.session import events as on
from wonderland_edge_agent.session.machine import PadSession
from wonderland_edge_agent.session.runner import PadRunner
from wonderland_edge_agent.spool import SpoolError
from wonderland_edge_agent.waiting import Waiting
from wonderland_edge_agent.witness import WitnessDuty

if TYPE_CHECKING:
    from pathlib import Path

    from wonderland.proofs.records.pads import Pad
    from wonderland.proofs.records.policies import Policy
    from wonderland_edge_agent.drift.keeper import DriftKeeper
    from wonderland_edge_agent.local_reports import LocalReports
    from wonderland_edge_agent.permission import Permission
    from wonderland_edge_agent.receiver import RemoteIdReceiver
    from wonderland_edge_agent.references.live import LiveTruth
    from wonderland_edge_agent.session.timing import PadTiming
    from wonderland_edge_agent.spool import Spool
    from wonderland_fabric_gateway.checkpoints import Checkpointer
    from wonderland_fabric_gateway.identity import Identity

_log = logging.getLogger(__name__)

CARE_S: Final = 5.0
"""Between two looks at prekeys and left-over sessions."""
AGAIN_S: Final = 1.0
LAG_S: Final = 0.1
"""Until a peer that is behind is asked again."""
_NOT_THERE: Final = 404
STOP_S: Final = 5.0
"""Longest that a session under way keeps the agent from stopping."""
LOOK_S: Final = 1.0
"""Between two looks at the queue, where nothing is told: time alone ends waiting."""
MAX_WITNESSED: Final = 16
"""Requests of other pads that wait for this one as witness."""


def _witness_of(record: dict[str, Any]) -> object:
    """The pad that a requested session names as witness."""
    witness = record.get("witness")
    return witness.get("pad_id") if isinstance(witness, dict) else None


class PadAgent:
    """One pad. ``run`` works until it is cancelled; then everything under way ends in a recorded state."""

    def __init__(
        self,
        pad_id: str,
        *,
        ledger: PadLedger,
        identity: Identity,
        radios: PadRadiosPort,
        receiver: RemoteIdReceiver,
        spool: Spool,
        permission: Permission,
        checkpointer: Checkpointer,
        clock: SteadyClock,
        prekeys: int = 20,
        timing: PadTiming | None = None,
        whole_certificate: bool = False,
        status_file: Path | None = None,
        drift: DriftKeeper | None = None,
        metrics_file: Path | None = None,
        roll_call_every_s: float = 0,
        hear_each_other: Callable[[str], bool] = lambda _: False,
        region: str | None = None,
        local: LocalReports | None = None,
        truth: LiveTruth | None = None,
        random_octets: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self.pad_id: Final = pad_id
        self._ledger = ledger
        self._identity = identity
        self._radios = radios
        self._receiver = receiver
        self._spool = spool
        self._permission = permission
        self._clock = clock
        self._timing = timing
        self._whole_certificate = whole_certificate
        self._status_file = status_file
        self._drift = drift
        self._metrics_file = metrics_file
        self._roll_call_every_s = roll_call_every_s
        self._hear_each_other = hear_each_other
        self._random_octets = random_octets
        self._reporter = SpoolReporter(spool, receiver.signature, local=local, truth=truth)
        self._prekeys = PrekeyKeeper(pad_id, spool, ledger, clock, prekeys)
        self._reconciler = Reconciler(ledger, self._reporter, clock)
        self._to_witness: asyncio.Queue[Session] = asyncio.Queue(MAX_WITNESSED)
        self._waiting = Waiting(pad_id, ledger=ledger, spool=spool, clock=clock)
        self._turn = asyncio.Event()
        self._runner: PadRunner | None = None
        self._witness = WitnessDuty(pad_id, ledger=ledger, radios=radios, prekeys=self._prekeys, clock=clock)
        self._own = OwnPad(pad_id, ledger)
        self._admission = Admission(
            ledger=ledger, own=self._own, radios=radios, drift=drift, spool=spool, region=region, clock=clock
        )
        self._pad: Pad | None = None
        self._policies: dict[str, Policy] = {}
        self._ledger_trouble = ""
        self._care = asyncio.Event()
        self._subscription = EventSubscription(ledger, checkpointer, self._take)
        self._started = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self._sessions = 0

    async def wait_ready(self) -> None:
        """Until prekeys are offered and requests are heard: from now on a drone can ask."""
        await self._started.wait()

    async def run(self) -> None:
        """Work until cancelled. Raises AgentError for what no waiting can cure."""
        interrupted = await self._spool.sessions()
        files = ((self._status_file, write_status), (self._metrics_file, write_metrics))
        telling = tell_health(self.status, self._health, self._reporter, files)
        parts = [self._follow(interrupted), self._take_care(), telling]
        if self._drift is not None:
            parts.append(watch_when_idle(self._drift, self._own, self._idle))
        if self._roll_call_every_s:
            every_s, known = self._roll_call_every_s, self._hear_each_other
            parts.append(call_when_idle(self._radios, self._own, self._idle, every_s, known))
        tasks = [asyncio.create_task(part) for part in parts]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            await self._stop(tasks)

    async def _follow(self, interrupted: dict[str, dict[str, Any]]) -> None:
        """Take up what was before a restart, then hear the ledger and serve."""
        begun = frozenset(session_id for session_id, state in interrupted.items() if state.get("begun"))
        await self._waiting.restore(begun)
        cut = {session_id: state for session_id, state in interrupted.items() if not self._waiting.waits(session_id)}
        self._reconciler.add_interrupted(cut)
        if cut:
            _log.warning("%d sessions were under way when this agent stopped; they are being ended", len(cut))
            self._care.set()
        tasks = [asyncio.create_task(each) for each in (self._subscription.run(), self._serve(), self._end_waiting())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()  # in its own words, which a group's would hide
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def status(self) -> dict[str, Any]:
        """How the agent is, for people and for ``wonderland pad status``."""
        runner = self._runner
        spool = self._spool.status
        now = self._now()
        reasons = why_not(now)
        waiting = self._waiting.status()
        return {
            "pad_id": self.pad_id,
            "process": os.getpid(),
            "t_ms": self._clock(),
            "accepts_sessions": not reasons,
            "cannot_prove": reasons,
            "not_known": [] if reasons else not_known(now),
            "not_for": [] if reasons else not_for(now),
            "goes_on_without": goes_on_without(now),
            "spool_reason": spool.reason,
            "session": runner.session.session_id if runner is not None else "",
            "sessions_run": self._sessions,
            "requests_waiting": len(waiting["waiting"]),
            "queue": waiting,
            "sessions_to_end": self._reconciler.waiting,
            "reach": reach_of(
                self._radios.states(), None if self._pad is None else self._pad.commissioning, self._radios.highest
            ),
            **telemetry.plain(self._health()),
        }

    def _now(self) -> Now:
        """What decides whether a drone can be proved now."""
        pad, spool = self._pad, self._spool
        digest = None if pad is None else pad.commissioning_sha256
        states, surveyed = self._radios.states(), None if pad is None else pad.commissioning
        highest = self._radios.highest
        return Now(
            ledger_trouble=self._ledger_trouble,
            pad=pad,
            anchors=states if self._radios.measured_by == "pad" else None,
            moved="" if self._drift is None or digest is None else self._drift.why_moved(digest),
            spool_trouble="" if spool.accepts_sessions else spool.status.reason or "the spool is full",
            prekeys=self._prekeys.available,
            looks=self._roll_call_every_s > 0,
            beyond={} if surveyed is None else beyond_here(surveyed, self._policies, states, highest),
        )

    # --- what the ledger says ----------------------------------------------------------------------------------

    async def _take(self, event: ContractEvent) -> bool:
        """What an event means for this pad; whether it was about it."""
        if event.name in {"ProofWitnessed", "ProofDecided"}:
            self._testified_or_decided(event)
        elif event.name == "ProofRequested" and _witness_of(event.record) == self.pad_id:
            self._asked_to_witness(event)
        if event.record.get("pad_id") == self.pad_id:
            await self._keep_queue(event)
        if event.record.get("pad_id") != self.pad_id or event.name in {"ProofWitnessed", "ProofDecided"}:
            return False
        match event.name:
            case "PadCommissioned" | "PadRetired":
                self._own.changed()
                self._care.set()
            case "ProofRequested" | "PrecedenceGiven" | "DepartureRecorded" | "PadReserved" | "ReservationCancelled":
                pass
            case _:
                self._ended_elsewhere(event)
        return True

    def _testified_or_decided(self, event: ContractEvent) -> None:
        """A witness's word for the session under way here, or the end of one that this pad is the witness of."""
        session_id = event.record.get("session_id")
        runner = self._runner
        if event.name == "ProofDecided":
            self._witness.ended(session_id)
        elif runner is not None and runner.session.session_id == session_id:
            runner.deliver(on.Witnessed(event.tx_id))

    async def _keep_queue(self, event: ContractEvent) -> None:
        """Raises AwayError where the ledger's own record is needed and away; the event comes again then."""
        try:
            if event.name == "ProofRequested":
                await self._remember(Session.parse(event.record).session_id)
            await self._waiting.take(event.name, event.record)
        except ProofError as error:
            _log.warning("event %s of transaction %s cannot be read: %s", event.name, event.tx_id, error)
        self._turn.set()

    def _asked_to_witness(self, event: ContractEvent) -> None:
        """Another pad's proof names this one as witness; where it is busy, that proof goes without."""
        try:
            self._to_witness.put_nowait(Session.parse(event.record))
            self._turn.set()
        except ProofError as error:
            _log.warning("transaction %s: not witnessed: %s", event.tx_id, error)
        except asyncio.QueueFull:
            _log.warning("transaction %s: not witnessed: too many requests wait", event.tx_id)

    def _ended_elsewhere(self, event: ContractEvent) -> None:
        try:
            session = Session.parse(event.record)
        except ProofError as error:
            _log.warning("event %s of transaction %s cannot be read: %s", event.name, event.tx_id, error)
            return
        runner = self._runner
        if runner is not None and runner.session.session_id == session.session_id:
            if event.name == "ProofCancelled":
                runner.deliver(on.SessionCancelled(session.ended_by or "", session.end or "cancelled"))
            else:
                runner.deliver(on.InteractionCompleted(session.end or "completed"))

    async def _remember(self, session_id: str, *, begun: bool = False) -> None:
        """Note durably that the session has to be ended, whatever happens to this process."""
        try:
            await self._spool.put_session(session_id, {"reason": "agent_restart", "begun": begun})
        except SpoolError as error:  # a full disk must not keep the pad from ending the session
            _log.error("session %.12s: not noted as in progress: %s", session_id, error)

    # --- one session after the other ---------------------------------------------------------------------------

    async def _serve(self) -> None:
        while True:
            self._turn.clear()
            if not self._to_witness.empty():
                await self._witness_one(self._to_witness.get_nowait())
                continue
            session = self._waiting.next()
            if session is None:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(LOOK_S):
                        await self._turn.wait()
                continue
            try:
                await self._waiting.record_override(session)
                await self._serve_one(session)
            except AwayError as error:  # nothing was begun: in a while, unless it has expired by then
                _log.warning("session %.12s: waits for the ledger: %s", session.session_id, error)
                await asyncio.sleep(AGAIN_S)
                self._waiting.again(session)
            except RefusedError as error:
                if error.status == _NOT_THERE:  # its event came from a peer that is further than the one asked
                    _log.info("session %.12s: waits for a peer that is behind: %s", session.session_id, error)
                    await asyncio.sleep(LAG_S)
                    self._waiting.again(session)
                    continue
                _log.warning("session %.12s: not begun: %s", session.session_id, error)
                self._reconciler.add(session.session_id, "not_begun")
            except ProofError as error:
                _log.warning("session %.12s: not begun: %s", session.session_id, error)
                self._reconciler.add(session.session_id, "malformed_session")
            self._care.set()

    async def _end_waiting(self) -> None:
        """End who waited too long, or waits behind too many, also while another is served."""
        while True:
            await asyncio.sleep(LOOK_S)
            for session_id, reason, note in self._waiting.to_end():
                self._reconciler.add(session_id, reason, note)
                self._care.set()

    async def _witness_one(self, session: Session) -> None:
        """Time-stamp a drone's blinks for another pad's proof. Whatever goes wrong, that proof goes without."""
        self._clock.resync()
        self._idle.clear()
        try:
            await self._witness.serve(session)
        finally:
            self._idle.set()
            self._care.set()

    async def _serve_one(self, session: Session) -> None:
        """Steps 2 to 8 of one request, if it is still to be served. Raises AwayError before anything was begun."""
        self._clock.resync()
        admitted = await self._admission.admit(session)
        if isinstance(admitted, NotAdmitted):
            self._reconciler.add(session.session_id, admitted.end, admitted.detail)
            return
        current, commissioning, digest = admitted.session, admitted.commissioning, admitted.digest
        private_key = await self._prekeys.take_key(session.prekey_id)
        if private_key is None:
            self._reconciler.add(session.session_id, "prekey_lost")
            return
        await self._remember(session.session_id, begun=True)
        if current.pad.certificate_sha256 != self._identity.certificate_sha256:
            _log.info("session %.12s: its prekey was published with another certificate", session.session_id)
        secret = keys.shared_secret(private_key, from_base64url(current.uav_key))
        session_keys = keys.derive(secret, digest)
        uav_id = current.uav_id
        drift_mm = None if self._drift is None else self._drift.extra_sigma_mm(session.commissioning_sha256)
        machine = PadSession(
            current,
            commissioning,
            session_keys,
            certificate=self._identity.certificate_der,
            broadcasts=partial(self._receiver.recent, uav_id),
            unsure=partial(self._receiver.unsure, uav_id),
            random_octets=self._random_octets,
            now_ms=self._clock(),
            timing=self._timing,
            whole_certificate=self._whole_certificate,
            measured_by=self._radios.measured_by,
            sts=self._radios.sts,
            interval_ms=self._radios.interval_ms,
            drift_sigma_mm=drift_mm,
        )
        self._receiver.watch(uav_id)
        runner = self._runner = PadRunner(
            machine,
            radios=self._radios,
            ledger=self._ledger,
            permission=self._permission,
            reporter=self._reporter,
            clock=self._clock,
        )
        self._idle.clear()
        self._sessions += 1
        _log.info("session %.12s: %s asks to %s", session.session_id, uav_id, session.action)
        try:
            finish = await runner.run()
        finally:
            self._runner = None
            self._idle.set()
            self._receiver.unwatch(uav_id)
        if self._drift is not None and machine.verdict is not None:
            self._drift.decided(machine.verdict, session.commissioning_sha256, commissioning, drift_mm)
        _log.info("session %.12s: %s (%s)", session.session_id, finish.state, finish.end)
        if not runner.settled:
            self._reconciler.add(session.session_id, finish.end)

    # --- what goes on beside -----------------------------------------------------------------------------------

    async def _take_care(self) -> None:
        """The pad's record, prekeys and left-over sessions, whenever something changed and every few seconds."""
        await self._subscription.placed.wait()
        while True:
            try:
                if not self._started.is_set() or self._prekeys.low:
                    await self._prekeys.ensure()
                self._pad = await self._own.refresh()
                if self._drift is not None and self._pad.commissioning is not None:
                    # What was found before a restart holds at once, not from the next look on.
                    self._drift.load(self._pad.commissioning_sha256 or "", self._pad.commissioning)
                self._policies = await self._own.policies()
                self._ledger_trouble = ""
                self._started.set()
                await self._reconciler.look_at_sessions()
            except AwayError as error:
                self._ledger_trouble = f"the ledger is away: {error}"
                _log.warning("%s", self._ledger_trouble)
            except RefusedError as error:
                self._ledger_trouble = f"the ledger refuses this pad: {error}"
                _log.error("%s", self._ledger_trouble)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CARE_S):
                    await self._care.wait()
            self._care.clear()

    def _health(self) -> Health:
        return health_record(
            self._radios.states(),
            self._spool.status,
            self._receiver.counts,
            self._prekeys.available,
            None if self._drift is None else self._drift.state,
        )

    async def _stop(self, tasks: list[asyncio.Task[None]]) -> None:
        """End what is under way in a recorded state, then everything else."""
        if self._runner is not None:
            self._runner.deliver(on.Interrupted("agent_stopped"))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(STOP_S):
                    await self._idle.wait()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._reporter.drain()
