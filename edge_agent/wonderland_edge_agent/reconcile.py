"""Sessions that this pad began and did not see end: after a restart, or while the ledger was away.

Each is looked up on the ledger until it stands in a final state there; one that is still open is cancelled. The end
is recorded in the spool once, together with forgetting the session.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final, Protocol

from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.telemetry import StepName

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wonderland.clock import Clock
    from wonderland.proofs.records.sessions import Session
    from wonderland.proofs.records.verdicts import Verdict

_log = logging.getLogger(__name__)

LAPSE_MARGIN_MS: Final = 2_000
UNKNOWN_MS: Final = 60_000
"""For so long a ledger must not know a session before it counts as one of another ledger: a peer may be behind."""
_NOT_THERE: Final = 404


class ReconcileLedger(Protocol):
    """The ledger, as far as ends of sessions go."""

    async def read_session(self, session_id: str) -> Session:
        """A session as it stands."""
        ...

    async def read_verdict(self, session_id: str) -> Verdict | None:
        """Its verdict, if there is one."""

    async def cancel(self, session_id: str, reason: str, note: str = "") -> tuple[Session, Committed]:
        """End it without a verdict."""
        ...


class Ends(Protocol):
    """Where ends are recorded (``wonderland_edge_agent.reporting.SpoolReporter``)."""

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
        """Record how a session ended, and forget that it was in progress."""


class Reconciler:
    """Ends left-over sessions, one look after the other."""

    def __init__(self, ledger: ReconcileLedger, ends: Ends, clock: Clock) -> None:
        self._ledger = ledger
        self._ends = ends
        self._clock = clock
        self._open: dict[str, tuple[str, str]] = {}
        self._unknown_ms: dict[str, int] = {}

    @property
    def waiting(self) -> int:
        """How many sessions have not ended yet."""
        return len(self._open)

    def add(self, session_id: str, reason: str, note: str = "") -> None:
        """Take on a session; ``reason`` is what it will be cancelled with, ``note`` for people, should it be open."""
        self._open.setdefault(session_id, (reason, note))

    def add_interrupted(self, sessions: Mapping[str, Mapping[str, Any]]) -> None:
        """Take on what the spool remembers from before a restart."""
        for session_id, state in sessions.items():
            reason = state.get("reason")
            self.add(session_id, reason if isinstance(reason, str) and reason else "agent_restart")

    async def look_at_sessions(self) -> None:
        """Look at each once. Never raises for a ledger that is away: the next look comes."""
        for session_id, (reason, note) in list(self._open.items()):
            try:
                done = await self._end(session_id, reason, note)
            except AwayError as error:
                _log.info("session %.12s: cannot be ended yet, the ledger is away: %s", session_id, error)
                return
            except RefusedError as error:
                _log.warning("session %.12s: %s", session_id, error)
                done = error.status == _NOT_THERE and self._is_unknown(session_id)
                if done:
                    self._ends.ended(session_id, "cancelled", "unknown_to_ledger", self._clock())
            else:
                self._unknown_ms.pop(session_id, None)
            if done:
                del self._open[session_id]
                self._unknown_ms.pop(session_id, None)

    def _is_unknown(self, session_id: str) -> bool:
        """Whether the ledger has not known a session for so long that no peer can be that far behind."""
        now_ms = self._clock()
        return now_ms - self._unknown_ms.setdefault(session_id, now_ms) >= UNKNOWN_MS

    async def _end(self, session_id: str, reason: str, note: str) -> bool:
        session = await self._ledger.read_session(session_id)
        tx_id = ""
        if session.state == "requested":
            session, done = await self._ledger.cancel(session_id, reason, note)
            tx_id = done.tx_id
        elif session.state == "decided":
            verdict = await self._ledger.read_verdict(session_id)
            if verdict is None or verdict.permission != "granted":
                self._ends.ended(session_id, "decided", "refused", self._clock())
                return True
            if self._clock() <= session.expires_ms + LAPSE_MARGIN_MS:
                return False  # the permission stands; the drone may be landing, and completes it
            session, done = await self._ledger.cancel(session_id, "permission_expired")
            tx_id = done.tx_id
        self._ends.ended(session_id, session.state, session.end or session.state, self._clock(), tx_id=tx_id)
        return True
