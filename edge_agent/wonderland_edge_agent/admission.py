"""Whether the pad begins a session that a drone asked for, by what the ledger, the nodes and the anchors say."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from wonderland.proofs.transcript import transcript_of
from wonderland.uwb.agreed import no_plan, pad_ability
from wonderland_edge_agent.assurance import beyond
from wonderland_fira_uci.errors import RangingPlanError

if TYPE_CHECKING:
    from wonderland.clock import Clock
    from wonderland.proofs.records.pads import Commissioning
    from wonderland.proofs.records.sessions import Session
    from wonderland_edge_agent.drift.keeper import DriftKeeper
    from wonderland_edge_agent.own_pad import OwnPad
    from wonderland_edge_agent.ports import PadLedger, PadRadiosPort
    from wonderland_edge_agent.spool import Spool

_log = logging.getLogger(__name__)

MIN_SESSION_MS: Final = 3_000
"""Of a session's life that has to be left."""


@dataclass(frozen=True, slots=True)
class Admitted:
    """``session`` as the ledger has it now, the survey that it rests on, and its transcript's digest."""

    session: Session
    commissioning: Commissioning
    digest: bytes


@dataclass(frozen=True, slots=True)
class NotAdmitted:
    """``end``: how the session is ended on the ledger; ``detail``: what is said beside it."""

    end: str
    detail: str = ""


class Admission:
    """One pad's. ``region``: whose channels alone are used; None: any."""

    def __init__(
        self,
        *,
        ledger: PadLedger,
        own: OwnPad,
        radios: PadRadiosPort,
        drift: DriftKeeper | None,
        spool: Spool,
        region: str | None,
        clock: Clock,
    ) -> None:
        self._ledger = ledger
        self._own = own
        self._radios = radios
        self._drift = drift
        self._spool = spool
        self._region = region
        self._clock = clock

    async def admit(self, session: Session) -> Admitted | NotAdmitted:
        """Look at everything that keeps it from being begun. Raises AwayError and RefusedError."""
        refusal = self._refusal(session)
        if refusal:
            return NotAdmitted(refusal)
        current, commissioning = await asyncio.gather(
            self._ledger.read_session(session.session_id), self._own.commissioning_of(session)
        )
        if current.state != "requested" or commissioning is None:
            return NotAdmitted("commissioning_changed")
        digest = transcript_of(current, self._ledger.channel).digest()
        if digest.hex() != current.transcript_sha256:
            _log.error("session %.12s: the ledger's transcript is not the one that follows from it", session.session_id)
            return NotAdmitted("transcript_mismatch")
        for end, problem in (
            ("no_radio_plan", no_plan(commissioning, current.node, self._region)),
            (
                "assurance_out_of_reach",
                beyond(self._known(commissioning), current.node, current.policy, self._radios.highest),
            ),
        ):
            if problem:
                _log.error("session %.12s refused: %s", session.session_id, problem)
                return NotAdmitted(end, problem)
        return Admitted(current, commissioning, digest)

    def _known(self, commissioning: Commissioning) -> Commissioning:
        """With what the nodes say now where the record does not tell it, as for a pad commissioned from a recording.

        For reasons only: the plan follows from what is on the ledger, which the drone has as well.
        """
        if commissioning.nodes is not None:
            return commissioning
        said = {state.anchor_id: state.capabilities for state in self._radios.states()}
        try:
            return replace(commissioning, nodes=pad_ability(said))
        except RangingPlanError:
            return commissioning

    def _refusal(self, session: Session) -> str:
        """What keeps it from being begun whatever it says; empty where nothing does."""
        if self._clock() > session.expires_ms - MIN_SESSION_MS:
            return "expired"
        moved = "" if self._drift is None else self._drift.why_moved(session.commissioning_sha256)
        if moved:
            _log.error("session %.12s refused: %s", session.session_id, moved)
            return "pad_moved"
        if not self._spool.accepts_sessions:
            _log.error("session %.12s refused: %s", session.session_id, self._spool.status.reason)
            return "pad_spool_full"
        return ""
