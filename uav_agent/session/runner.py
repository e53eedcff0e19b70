"""The thin shell around the drone's machine: it hands in events and the time, and performs the actions."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine
from typing import Final

from uav_agent.session import actions as do
from uav_agent.session import events as on
from uav_agent.session.machine import UavSession
from uav_agent.session.ports import Act, Radio, UavLedger
from wonderland.clock import Clock
from wonderland.ledger.errors import SignatureError
from wonderland.ledger.proof_contract import AwayError, RefusedError
from wonderland.ledger.signing import Signer, raw_from_der
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.uwb.errors import UwbError
from wonderland.uwb.layout import RangingPlan

_log = logging.getLogger(__name__)

RETRY_FIRST_S: Final = 0.2
RETRY_MAX_S: Final = 3.0
CANCEL_PATIENCE_S: Final = 10.0
COMPLETE_PATIENCE_S: Final = 60.0

StepListener = Callable[[Session, do.ReportStep], None]


class SessionRunner:
    """Runs one session of one drone to its end."""

    def __init__(
        self,
        machine: UavSession,
        *,
        radio: Radio,
        ledger: UavLedger,
        signer: Signer,
        act: Act,
        clock: Clock,
        on_step: StepListener | None = None,
    ) -> None:
        self._machine = machine
        self._radio = radio
        self._ledger = ledger
        self._signer = signer
        self._act = act
        self._clock = clock
        self._on_step = on_step
        self._events: list[on.UavEvent] = []
        self._wake = asyncio.Event()
        self._frames_due = asyncio.Event()
        self._sending = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._acting: asyncio.Task[None] | None = None
        self._finish: do.Finish | None = None
        self.completed_tx = ""
        """Transaction that closed the session, if this drone's did."""
        self.verdict_tx = ""

    @property
    def session(self) -> Session:
        """The session that runs here."""
        return self._machine.session

    @property
    def verdict(self) -> Verdict | None:
        """The committed verdict, once there is one."""
        return self._machine.verdict

    def deliver(self, event: on.UavEvent) -> None:
        """Tell the session something: a report of the node, an event of the ledger."""
        if isinstance(event, on.VerdictCommitted):
            self.verdict_tx = event.tx_id
        self._events.append(event)
        self._wake.set()

    async def run(self) -> do.Finish:
        """Until the session has ended for this drone."""
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
            tasks = (frames, *self._tasks)
            for task in tasks:
                task.cancel()
            for task in tasks:
                with contextlib.suppress(asyncio.CancelledError):
                    await task
            await self._radio.close_session()

    async def _wait(self) -> None:
        """Until something happened or the machine or its link wants to look at the clock."""
        if not self._events:
            # While a frame waits for the node's credit, others are due all the time: do not spin meanwhile.
            frames_ms = None if self._sending else self._machine.next_frames_ms()
            times = [t_ms for t_ms in (self._machine.next_tick_ms(), frames_ms) if t_ms is not None]
            delay_s = max(0.001, (min(times) - self._clock()) / 1000) if times else None
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
                    await self._radio.send(frames[0])
                except UwbError as error:
                    _log.debug("a frame was not sent and will be repeated: %s", error)
                    break
                finally:
                    self._sending = False
                    self.deliver(on.Tick())

    async def _perform(self, actions: list[do.UavAction]) -> None:
        for action in actions:
            match action:
                case do.OpenRadios():
                    self._start(self._open(action.plan))
                case do.CloseRadios():
                    await self._radio.close_session()
                case do.AnswerInBlinks():
                    self._start(self._answer_in_blinks(action.answer))
                case do.Sign():
                    self._sign(action.statement)
                case do.Act():
                    self._acting = self._start(self._do(action.verdict))
                case do.StopActing():
                    if self._acting is not None:
                        self._acting.cancel()
                case do.Complete():
                    await self._complete(action)
                case do.Cancel():
                    await self._cancel(action)
                case do.ReportStep():
                    if self._on_step is not None:
                        self._on_step(self.session, action)
                case do.Finish():
                    self._finish = action

    def _start(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _open(self, plan: RangingPlan) -> None:
        try:
            await self._radio.open_session(plan, self.deliver)
        except Exception as error:  # noqa: BLE001 - whatever the node does, the session ends in a recorded state
            self.deliver(on.RadiosFailed(str(error) or type(error).__name__))
        else:
            self.deliver(on.RadiosOpened())

    async def _answer_in_blinks(self, answer: bytes) -> None:
        try:
            await self._radio.answer_in_blinks(answer)
        except UwbError as error:
            _log.warning("the blinks carry no answer, so that the pad cannot use their time stamps: %s", error)

    def _sign(self, statement: bytes) -> None:
        try:
            self.deliver(on.Signed(raw_from_der(self._signer(statement))))
        except SignatureError as error:
            self.deliver(on.SignFailed(str(error)))

    async def _do(self, verdict: Verdict) -> None:
        try:
            result = await self._act(verdict)
        except Exception as error:  # noqa: BLE001 - whatever the callback does, the session is closed on the ledger
            _log.exception("the permitted action failed")
            self.deliver(on.Acted("aborted", f"{type(error).__name__}: {error}"[:200]))
        else:
            self.deliver(on.Acted("done" if result == "done" else "aborted", "" if result == "done" else result[:200]))

    async def _complete(self, action: do.Complete) -> None:
        """CompleteInteraction, again and again while the ledger is away; a second one is refused and harmless."""
        pause_s, deadline = RETRY_FIRST_S, asyncio.get_running_loop().time() + COMPLETE_PATIENCE_S
        while True:
            try:
                _, done = await self._ledger.complete(self.session.session_id, action.result, action.note)
            except RefusedError as error:
                _log.info("session %.12s: not completed: %s", self.session.session_id, error)
                return
            except AwayError as error:
                _log.warning("session %.12s: the ledger is away: %s", self.session.session_id, error)
                if asyncio.get_running_loop().time() > deadline:
                    return
            else:
                self.completed_tx = done.tx_id
                return
            await asyncio.sleep(pause_s)
            pause_s = min(RETRY_MAX_S, 2 * pause_s)

    async def _cancel(self, action: do.Cancel) -> None:
        try:
            async with asyncio.timeout(CANCEL_PATIENCE_S):
                _, done = await self._ledger.cancel(self.session.session_id, action.reason, action.note)
        except (AwayError, TimeoutError) as error:
            _log.warning("session %.12s: not cancelled, the ledger is away: %s", self.session.session_id, error)
        except RefusedError as error:
            _log.info("session %.12s: not cancelled: %s", self.session.session_id, error)
        else:
            self.completed_tx = done.tx_id
