"""What a session needs of the world; the shell is given these, tests give it others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from wonderland.proof_contract import Committed
from wonderland.proofs.records.sessions import Evidence, Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.telemetry import StepName
from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.session import actions as do
from wonderland_edge_agent.session import events as on

Sink = Callable[[on.PadEvent], None]
"""Where reports go."""


class Radios(Protocol):
    """The pad's nodes (``wonderland_edge_agent.radios.PadRadios``)."""

    @property
    def measured_by(self) -> str:
        """Whose nodes compute the ranges, as in the record ``Radio``: pad or uav."""
        ...

    @property
    def sts(self) -> str:
        """Their time-stamp sequence, as in the record ``Radio``: static or provisioned."""
        ...

    @property
    def interval_ms(self) -> int | None:
        """How often they range where no radio plan says it."""
        ...

    async def open_session(self, plan: RangingPlan, anchor_ids: Sequence[str], sink: Sink) -> str | None:
        """Start both UWB sessions; returns the firmware. Raises where the pad cannot range."""

    async def send(self, frame: bytes) -> None:
        """Hand a frame to the node that speaks; raises UwbError."""

    async def close_session(self) -> None:
        """Stop both UWB sessions; never raises."""


class SessionLedger(Protocol):
    """The ledger (``wonderland.proof_contract.ProofContract``); raises RefusedError and AwayError."""

    async def submit_proof(self, session_id: str, evidence: Evidence) -> tuple[Verdict, Committed]:
        """The evidence, for a verdict."""
        ...

    async def cancel(self, session_id: str, reason: str, note: str = "") -> tuple[Session, Committed]:
        """End a session without a verdict."""
        ...

    async def read_session(self, session_id: str) -> Session:
        """A session as it stands."""
        ...

    async def read_verdict(self, session_id: str) -> Verdict | None:
        """Its verdict, if there is one."""


class Reporter(Protocol):
    """Who is told what happens; everything told is unverified."""

    def step(self, session: Session, report: do.ReportStep) -> None:
        """A step was reached or failed."""

    def estimate(self, session: Session, report: do.ReportEstimate) -> None:
        """A running estimate."""

    def finish(self, session: Session, report: do.Finish, steps: Mapping[StepName, int], *, settled: bool) -> None:
        """The session is over for this pad; ``settled`` where the ledger holds the state that the report names."""
