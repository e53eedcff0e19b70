"""Telling the backend, by way of the spool: steps and ends as evidence, estimates as telemetry."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from edge_agent.spool import SpoolError

if TYPE_CHECKING:
    from edge_agent.session import actions as do
    from edge_agent.spool import Spool
    from wonderland.proofs.records.sessions import Session

_log = logging.getLogger(__name__)

MAX_DETAIL = 300
Signature = Callable[[str, int], "dict[str, Any] | None"]


class SpoolReporter:
    """A session's reporter; ``drain`` waits until all that was reported is durable.

    ``signature`` tells who signed a drone's broadcasts since a time: with a session's end that binds who said it to
    what was measured.
    """

    def __init__(self, spool: Spool, signature: Signature | None = None) -> None:
        self._spool = spool
        self._signature = signature
        self._signatures: dict[str, dict[str, Any]] = {}
        self._writes: set[asyncio.Task[None]] = set()

    def step(self, session: Session, report: do.ReportStep) -> None:
        """A step was reached or failed."""
        body: dict[str, Any] = {
            "session_id": session.session_id,
            "uav_id": session.uav_id,
            "step": report.step,
            "t_ms": report.t_ms,
            "ok": report.ok,
        }
        if report.detail:
            body["detail"] = report.detail[:MAX_DETAIL]
        self._evidence("step", report.t_ms, body)

    def estimate(self, session: Session, report: do.ReportEstimate) -> None:
        """A running estimate; nothing is told where the ranges give none yet."""
        verdict = report.verdict
        if verdict.estimate is None or verdict.covariance is None:
            return
        self._offer(
            "estimate",
            report.t_ms,
            {
                "session_id": session.session_id,
                "uav_id": session.uav_id,
                "lat_e7": verdict.estimate.lat_e7,
                "lon_e7": verdict.estimate.lon_e7,
                "east_mm": verdict.estimate.east_mm,
                "north_mm": verdict.estimate.north_mm,
                "ee_mm2": verdict.covariance.ee_mm2,
                "en_mm2": verdict.covariance.en_mm2,
                "nn_mm2": verdict.covariance.nn_mm2,
                "rounds": verdict.rounds,
                "likelihood_ppm": verdict.signed.likelihood_ppm if verdict.signed is not None else 0,
                "ranges": report.ranges,
            },
        )

    def finish(self, session: Session, report: do.Finish, steps: dict[str, int], *, settled: bool) -> None:
        """The session is over; where the ledger does not know yet, its end is recorded when it does."""
        found = self._signature(session.uav_id, session.requested_ms) if self._signature is not None else None
        if found is not None:
            self._signatures[session.session_id] = found
        if settled:
            self.ended(session.session_id, report.state, report.end, report.t_ms, tx_id=report.tx_id, steps=steps)

    def ended(
        self, session_id: str, state: str, end: str, t_ms: int, *, tx_id: str = "", steps: dict[str, int] | None = None
    ) -> None:
        """Record how a session ended, once, and forget that it was in progress."""
        body: dict[str, Any] = {
            "session_id": session_id,
            "state": state,
            "steps": [{"step": step, "t_ms": at_ms} for step, at_ms in (steps or {}).items()],
        }
        if end:
            body["end"] = end
        if tx_id:
            body["tx_id"] = tx_id
        signature = self._signatures.pop(session_id, None)
        if signature is not None:
            body["signature"] = signature
        self._evidence("session_end", t_ms, body, ends_session=session_id)

    def offer(self, kind: str, t_ms: int, body: dict[str, Any]) -> None:
        """Any other telemetry."""
        self._offer(kind, t_ms, body)

    async def drain(self) -> None:
        """Until everything reported so far is durable, or was refused."""
        while self._writes:
            await asyncio.gather(*self._writes, return_exceptions=True)

    def _evidence(self, kind: str, t_ms: int, body: dict[str, Any], *, ends_session: str | None = None) -> None:
        task = asyncio.create_task(self._write(kind, t_ms, body, ends_session))
        self._writes.add(task)
        task.add_done_callback(self._writes.discard)

    async def _write(self, kind: str, t_ms: int, body: dict[str, Any], ends_session: str | None) -> None:
        try:
            await self._spool.append(kind, t_ms, body, evidence=True, ends_session=ends_session)
        except SpoolError as error:
            # The verdict stands on the ledger; what is missing here is the backend's own log of it.
            _log.error("spool: a %s could not be kept: %s", kind, error)

    def _offer(self, kind: str, t_ms: int, body: dict[str, Any]) -> None:
        try:
            self._spool.offer(kind, t_ms, body)
        except SpoolError as error:
            _log.warning("spool: a %s was not kept: %s", kind, error)
