"""The thin shell around a session's machine: it hands in events and the time, and performs the actions."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Coroutine
from typing import Final

from edge_agent.permission import Permission
from edge_agent.session import actions as do
from edge_agent.session import events as on
from edge_agent.session.machine import PadSession
from edge_agent.session.ports import Radios, Reporter, SessionLedger
from wonderland.clock import Clock
from wonderland.ledger.proof_contract import AwayError, RefusedError
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.uwb.errors import UwbError
from wonderland.uwb.layout import RangingPlan

_log = logging.getLogger(__name__)

RETRY_FIRST_S: Final = 0.2
RETRY_MAX_S: Final = 3.0
CANCEL_PATIENCE_S: Final = 10.0
"""How long a session waits for its cancellation; after that the agent sees to it later."""
_ALREADY_DECIDED: Final = frozenset({"SESSION_DECIDED", "SESSION_COMPLETED"})
"""An earlier SubmitProof went through though its answer was lost; the drone may have acted on it since."""
_EXPIRED_GRACE_MS: Final = 2_000


class SessionRunner:
    """Runs one session to its end."""

    def __init__(
        self,
        machine: PadSession,
        *,
        radios: Radios,
        ledger: SessionLedger,
        permission: Permission,
        reporter: Reporter,
        clock: Clock,
    ) -> None:
        self._machine = machine
        self._radios = radios
        self._ledger = ledger
        self._permission = permission
        self._reporter = reporter
        self._clock = clock
        self._events: list[on.PadEvent] = []
        self._wake = asyncio.Event()
        self._frames_due = asyncio.Event()
        self._sending = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._finish: do.Finish | None = None
        self._cancelled_tx = ""
        self.settled = True
        """Whether the ledger holds the state that the end of the session names."""

    @property
    def session(self) -> Session:
        """The session that runs here."""
        return self._machine.session

    def deliver(self, event: on.PadEvent) -> None:
        """Tell the session something: a report of a node, an event of the ledger."""
        self._events.append(event)
        self._wake.set()

    async def run(self) -> do.Finish:
        """Until the session has ended for this pad; its last record says how."""
        frames = asyncio.create_task(self._send_frames())
        try:
            await self._perform(self._machine.start(self._clock()))
            while self._finish is None:
                await self._wait()
                events, self._events = self._events or [on.Tick()], []
                for event in events:
                    await self._perform(self._machine.handle(event, self._clock()))
                self._frames_due.set()
            return self._finish
        finally:
            for task in (frames, *self._tasks):
                task.cancel()
            for task in (frames, *self._tasks):
                with contextlib.suppress(asyncio.CancelledError):
                    await task
            await self._radios.close_session()

    async def _wait(self) -> None:
        """Until something happened or the machine or its link wants to look at the clock."""
        if not self._events:
            times = [
                t_ms for t_ms in (self._machine.next_tick_ms(), self._machine.next_frames_ms()) if t_ms is not None
            ]
            delay_s = max(0.0, (min(times) - self._clock()) / 1000) if times else None
            # A frame that waits for the node's credit is due all the time: do not spin meanwhile.
            delay_s = max(delay_s, 0.005) if delay_s is not None else None
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(delay_s):
                    await self._wake.wait()
        self._wake.clear()

    async def _send_frames(self) -> None:
        while True:
            await self._frames_due.wait()
            self._frames_due.clear()
            while frames := self._machine.frames_to_send(self._clock(), 1):
                self._sending = True
                try:
                    await self._radios.send(frames[0])
                except UwbError as error:
                    _log.debug("a frame was not sent and will be repeated: %s", error)
                    break
                finally:
                    self._sending = False
                    self.deliver(on.Tick())

    async def _perform(self, actions: list[do.PadAction]) -> None:
        for action in actions:
            match action:
                case do.OpenRadios():
                    self._start(self._open(action.plan))
                case do.CloseRadios():
                    await self._radios.close_session()
                case do.Submit():
                    self._start(self._submit(action.evidence))
                case do.Cancel():
                    await self._cancel(action)
                case do.Permit():
                    await self._permission.grant(action.verdict)
                    self.deliver(on.Permitted())
                case do.Withdraw() if self._machine.verdict is not None:
                    await self._permission.withdraw(self._machine.verdict, action.reason)
                case do.ReportStep():
                    self._reporter.step(self.session, action)
                case do.ReportEstimate():
                    self._reporter.estimate(self.session, action)
                case do.Finish():
                    self._finish = self._with_tx(action)
                    self.settled = self.settled and self._is_final(action)
                    steps = self._machine.evidence.steps
                    self._reporter.finish(self.session, self._finish, steps, settled=self.settled)
                case _:
                    pass

    def _is_final(self, finish: do.Finish) -> bool:
        """Whether nothing is left to be done on the ledger; a permission that nobody completed is not final."""
        verdict = self._machine.verdict
        permitted = verdict is not None and verdict.permission == "granted"
        return finish.state in {"cancelled", "completed"} or (finish.state == "decided" and not permitted)

    def _with_tx(self, finish: do.Finish) -> do.Finish:
        if finish.tx_id or not self._cancelled_tx:
            return finish
        return do.Finish(finish.state, finish.end, finish.t_ms, self._cancelled_tx, finish.detail)

    def _start(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _open(self, plan: RangingPlan) -> None:
        anchor_ids = [anchor.anchor_id for anchor in self._machine.commissioning.anchors]
        try:
            firmware = await self._radios.open_session(plan, anchor_ids, self.deliver)
        except Exception as error:  # noqa: BLE001 - whatever a node does, the session ends in a recorded state
            self.deliver(on.RadiosFailed(str(error) or type(error).__name__))
        else:
            self.deliver(on.RadiosOpened(firmware))

    async def _submit(self, evidence: Evidence) -> None:
        """SubmitProof, again and again while the ledger is away, but never twice: what stands there counts."""
        session = self.session
        pause_s = RETRY_FIRST_S
        while True:
            try:
                verdict, done = await self._ledger.submit_proof(session.session_id, evidence)
            except RefusedError as error:
                await self._refused(error)
                return
            except AwayError as error:
                if self._clock() > session.expires_ms + _EXPIRED_GRACE_MS:
                    self.deliver(on.LedgerLost(str(error)))
                    return
                _log.warning("session %.12s: the ledger is away: %s", session.session_id, error)
            else:
                self.deliver(on.VerdictCommitted(verdict, done.tx_id))
                return
            await asyncio.sleep(pause_s)
            pause_s = min(RETRY_MAX_S, 2 * pause_s)
            if await self._adopt():
                return

    async def _refused(self, error: RefusedError) -> None:
        if error.code in _ALREADY_DECIDED and await self._adopt():
            return
        self.deliver(on.SubmitRefused(_machine_word(error.code), error.text))

    async def _adopt(self) -> bool:
        """Take over what stands on the ledger, if the session is past being decided; False while it is not."""
        try:
            session = await self._ledger.read_session(self.session.session_id)
            if session.state == "cancelled":
                self.deliver(on.SessionCancelled(session.ended_by or "", session.end or "cancelled"))
                return True
            verdict = await self._ledger.read_verdict(session.session_id) if session.state != "requested" else None
        except (AwayError, RefusedError):
            return False
        if verdict is None:
            return False
        self.deliver(on.VerdictCommitted(verdict, ""))
        return True

    async def _cancel(self, action: do.Cancel) -> None:
        try:
            async with asyncio.timeout(CANCEL_PATIENCE_S):
                _, done = await self._ledger.cancel(self.session.session_id, action.reason, action.note)
        except (AwayError, TimeoutError) as error:
            self.settled = False
            _log.warning("session %.12s: not cancelled yet, the ledger is away: %s", self.session.session_id, error)
        except RefusedError as error:  # someone else ended it: the ledger says how
            self.settled = False
            _log.info("session %.12s: not cancelled: %s", self.session.session_id, error)
        else:
            self._cancelled_tx = done.tx_id


def _machine_word(code: str) -> str:
    """A contract's code as the records spell reasons."""
    return "".join(letter if letter.isalnum() else "_" for letter in code.lower())[:64] or "refused"
