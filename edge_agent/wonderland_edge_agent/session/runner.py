"""Performs what a session on the pad wants done: radios, the ledger, the permission, the reports."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Final

from wonderland.clock import Clock
from wonderland.proof_contract import AwayError, RefusedError
from wonderland.proofs.records.sessions import Evidence
from wonderland.session.runner import Pauses, SessionRunner
from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.permission import Permission
from wonderland_edge_agent.session import actions as do
from wonderland_edge_agent.session import events as on
from wonderland_edge_agent.session.machine import PadSession
from wonderland_edge_agent.session.ports import Radios, Reporter, SessionLedger

_log = logging.getLogger(__name__)

_ALREADY_DECIDED: Final = frozenset({"SESSION_DECIDED", "SESSION_COMPLETED"})
"""An earlier SubmitProof went through though its answer was lost; the drone may have acted on it since."""
_EXPIRED_GRACE_MS: Final = 2_000


class PadRunner(SessionRunner[do.PadAction, on.PadEvent]):
    """Runs one session of the pad to its end."""

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
        super().__init__(machine, speaker=radios, ledger=ledger, clock=clock)
        self._machine = machine
        self._radios = radios
        self._ledger = ledger
        self._permission = permission
        self._reporter = reporter
        self._cancelled_tx = ""
        self.settled = True
        """Whether the ledger holds the state that the end of the session names."""

    async def _perform(self, action: do.PadAction) -> None:
        match action:
            case do.OpenRadios():
                self._start(self._open(action.plan))
            case do.CloseRadios():
                await self._radios.close_session()
            case do.Submit():
                self._start(self._submit(action.evidence))
            case do.Cancel():
                tx_id = await self._cancel(action)
                self.settled = self.settled and tx_id is not None
                self._cancelled_tx = tx_id or self._cancelled_tx
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
                self._finish = replace(action, tx_id=action.tx_id or self._cancelled_tx)
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
        pauses = Pauses()
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
            await pauses.pause()
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


def _machine_word(code: str) -> str:
    """A contract's code as the records spell reasons."""
    return "".join(letter if letter.isalnum() else "_" for letter in code.lower())[:64] or "refused"
