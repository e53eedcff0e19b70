"""Telling the backend, by way of the spool: steps and ends as evidence, estimates as telemetry."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from wonderland import telemetry
from wonderland.telemetry import EndStep, Estimate, SessionEnd, Signature, Step, StepName
from wonderland_edge_agent.spool import SpoolError

if TYPE_CHECKING:
    from wonderland.proofs.records.sessions import Session
    from wonderland.telemetry import Body
    from wonderland_edge_agent.local_reports import LocalReports
    from wonderland_edge_agent.references.live import LiveTruth
    from wonderland_edge_agent.session import actions as do
    from wonderland_edge_agent.spool import Spool

_log = logging.getLogger(__name__)

MAX_DETAIL = 300
SignatureSince = Callable[[str, int], Signature | None]


class SpoolReporter:
    """A session's reporter; ``drain`` waits until all that was reported is durable.

    ``signature`` tells who signed a drone's broadcasts since a time: with a session's end that binds who said it to
    what was measured. ``local`` hears the same, for other programs of this machine. ``truth``: shown beside estimates.
    """

    def __init__(
        self,
        spool: Spool,
        signature: SignatureSince | None = None,
        *,
        local: LocalReports | None = None,
        truth: LiveTruth | None = None,
    ) -> None:
        self._spool = spool
        self._local = local
        self._truth = truth
        self._signature = signature
        self._signatures: dict[str, Signature] = {}
        self._writes: set[asyncio.Task[None]] = set()

    def step(self, session: Session, report: do.ReportStep) -> None:
        """A step was reached or failed."""
        body = Step(
            session_id=session.session_id,
            uav_id=session.uav_id,
            step=report.step,
            t_ms=report.t_ms,
            ok=report.ok,
            detail=telemetry.clean(report.detail, MAX_DETAIL) or None,
        )
        self._evidence(report.t_ms, body)

    def estimate(self, session: Session, report: do.ReportEstimate) -> None:
        """A running estimate; nothing is told where the ranges give none yet."""
        verdict = report.verdict
        if verdict.estimate is None or verdict.covariance is None:
            return
        at = report.t_ms if verdict.estimate_ms is None else verdict.estimate_ms
        true = None if self._truth is None else self._truth.of(session.uav_id, at)
        body = Estimate(
            session_id=session.session_id,
            uav_id=session.uav_id,
            lat_e7=verdict.estimate.lat_e7,
            lon_e7=verdict.estimate.lon_e7,
            east_mm=verdict.estimate.east_mm,
            north_mm=verdict.estimate.north_mm,
            ee_mm2=verdict.covariance.ee_mm2,
            en_mm2=verdict.covariance.en_mm2,
            nn_mm2=verdict.covariance.nn_mm2,
            rounds=verdict.rounds,
            likelihood_ppm=verdict.signed.likelihood_ppm if verdict.signed is not None else 0,
            ranges=report.ranges,
            truth_east_mm=None if true is None else round(1000 * true[0]),
            truth_north_mm=None if true is None else round(1000 * true[1]),
        )
        self.offer(report.t_ms, body)

    def finish(self, session: Session, report: do.Finish, steps: Mapping[StepName, int], *, settled: bool) -> None:
        """The session is over; where the ledger does not know yet, its end is recorded when it does."""
        found = self._signature(session.uav_id, session.requested_ms) if self._signature is not None else None
        if found is not None:
            self._signatures[session.session_id] = found
        if settled:
            self.ended(session.session_id, report.state, report.end, report.t_ms, tx_id=report.tx_id, steps=steps)

    def ended(
        self,
        session_id: str,
        state: str,
        end: str,
        t_ms: int,
        *,
        tx_id: str = "",
        steps: Mapping[StepName, int] | None = None,
    ) -> None:
        """Record how a session ended, once, and forget that it was in progress."""
        body = SessionEnd(
            session_id=session_id,
            state=state,
            steps=tuple(EndStep(step=step, t_ms=at_ms) for step, at_ms in (steps or {}).items()),
            end=end or None,
            tx_id=tx_id or None,
            signature=self._signatures.pop(session_id, None),
        )
        self._evidence(t_ms, body, ends_session=session_id)

    def offer(self, t_ms: int, body: Body) -> None:
        """Telemetry: soon durable, dropped under pressure."""
        self._tell_local(t_ms, body)
        try:
            self._spool.offer(body.KIND, t_ms, telemetry.plain(body))
        except SpoolError as error:
            _log.warning("spool: a %s was not kept: %s", body.KIND, error)

    async def drain(self) -> None:
        """Until everything reported so far is durable, or was refused."""
        while self._writes:
            await asyncio.gather(*self._writes, return_exceptions=True)

    def _tell_local(self, t_ms: int, body: Body) -> None:
        if self._local is not None:
            self._local.tell(t_ms, body)

    def _evidence(self, t_ms: int, body: Body, *, ends_session: str | None = None) -> None:
        self._tell_local(t_ms, body)
        task = asyncio.create_task(self._write(t_ms, body, ends_session))
        self._writes.add(task)
        task.add_done_callback(self._writes.discard)

    async def _write(self, t_ms: int, body: Body, ends_session: str | None) -> None:
        try:
            await self._spool.append(body.KIND, t_ms, telemetry.plain(body), evidence=True, ends_session=ends_session)
        except SpoolError as error:
            # The verdict stands on the ledger; what is missing here is the backend's own log of it.
            _log.error("spool: a %s could not be kept: %s", body.KIND, error)
