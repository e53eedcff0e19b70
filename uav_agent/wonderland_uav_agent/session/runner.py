"""Performs what a session on the drone wants done: its radio, its key, the ledger, the permitted action."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from wonderland.clock import Clock
from wonderland.proof_contract import AwayError, RefusedError
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.session.runner import Pauses, SessionRunner
from wonderland.uwb.layout import RangingPlan
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import Signer, raw_from_der
from wonderland_fira_uci.errors import UwbError
from wonderland_uav_agent.session import actions as do
from wonderland_uav_agent.session import events as on
from wonderland_uav_agent.session.machine import UavSession
from wonderland_uav_agent.session.ports import Act, Radio, UavLedger

_log = logging.getLogger(__name__)

COMPLETE_PATIENCE_S: Final = 60.0

StepListener = Callable[[Session, do.ReportStep], None]
RangeListener = Callable[[Commissioning, on.OwnRange], None]
"""Hears each range that the drone's node measures in a session, beside the pad's survey."""


class UavRunner(SessionRunner[do.UavAction, on.UavEvent]):
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
        on_range: RangeListener | None = None,
    ) -> None:
        super().__init__(machine, speaker=radio, ledger=ledger, clock=clock)
        self._machine = machine
        self._radio = radio
        self._ledger = ledger
        self._signer = signer
        self._act = act
        self._on_step = on_step
        self._on_range = on_range
        self._acting: asyncio.Task[None] | None = None
        self.completed_tx = ""
        """Transaction that closed the session, if this drone's did."""
        self.verdict_tx = ""

    @property
    def verdict(self) -> Verdict | None:
        """The committed verdict, once there is one."""
        return self._machine.verdict

    def deliver(self, event: on.UavEvent) -> None:
        """Tell the session something: a report of the node, an event of the ledger."""
        if isinstance(event, on.VerdictCommitted):
            self.verdict_tx = event.tx_id
        elif isinstance(event, on.OwnRange) and self._on_range is not None:
            self._on_range(self._machine.commissioning, event)
        super().deliver(event)

    async def _perform(self, action: do.UavAction) -> None:
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
                self.completed_tx = await self._cancel(action) or self.completed_tx
            case do.ReportStep():
                if self._on_step is not None:
                    self._on_step(self.session, action)
            case do.Finish():
                self._finish = action

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
        pauses, deadline = Pauses(), asyncio.get_running_loop().time() + COMPLETE_PATIENCE_S
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
            await pauses.pause()
