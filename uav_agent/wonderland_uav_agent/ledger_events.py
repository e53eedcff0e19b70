"""What the ledger decided, for all drones of a process: one event stream, handed out by session.

An event alone permits nothing. Organisations that may endorse could agree on an event about a session that is another
operator's, but not on the session, which bears the signature of its pad's organisation (decision 0005). So a drone
reads what the ledger holds of the session before it believes that it may land.
"""

from __future__ import annotations

import asyncio
import logging
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Final, Protocol, Self

from wonderland.proof_contract import ContractEvent
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.session import events as on

_log = logging.getLogger(__name__)

NAMES: Final = frozenset({"ProofDecided", "ProofCancelled"})
_AGAIN_S: Final = 1.0
PATIENCE_S: Final = 5.0
"""How long a peer may not know yet what an event told; the one that is asked can be behind the one that told."""
_PAUSE_S: Final = 0.1
_REMEMBERED: Final = 256
"""Events that nobody listens to yet: one of a request may arrive before its sender knows the session's id."""


class EventSource(Protocol):
    """The contract's events (``wonderland.proof_contract.ProofContract``)."""

    async def height(self) -> int:
        """How many blocks the channel has."""
        ...

    def events(self, *, start_block: int | None = None, names: frozenset[str]) -> AsyncIterator[ContractEvent]:
        """Events with these names, for ever."""
        ...

    async def read_verdict(self, session_id: str) -> Verdict | None:
        """The verdict of a session as the ledger holds it; None while there is none."""
        ...


class LedgerEvents:
    """Verdicts and cancellations by session. Open it before a request is sent: nothing committed after is missed."""

    def __init__(self, source: EventSource, *, patience_s: float = PATIENCE_S, at_once: bool = True) -> None:
        """`at_once`: listen when it is opened, or fail; otherwise from the first `look` that succeeds."""
        self._source = source
        self._at_once = at_once
        self._patience_s = patience_s
        self._listeners: dict[str, Callable[[on.UavEvent], None]] = {}
        self._early: OrderedDict[str, ContractEvent] = OrderedDict()
        self._task: asyncio.Task[None] | None = None
        self._confirming: set[asyncio.Task[None]] = set()
        self._next_block = 0

    async def __aenter__(self) -> Self:
        if self._at_once:
            await self.look()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        tasks = [*self._confirming, *([self._task] if self._task is not None else [])]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def look(self) -> None:
        """Ask the ledger whether it is there, and listen from the first answer on. Raises `LedgerError`."""
        height = await self._source.height()
        if self._task is None:
            self._next_block = height
            self._task = asyncio.create_task(self._run())

    def listen(self, session_id: str, listener: Callable[[on.UavEvent], None]) -> None:
        """Hand this session's events to ``listener``, also those that came before."""
        self._listeners[session_id] = listener
        early = self._early.pop(session_id, None)
        if early is not None:
            self._hand_out(early)

    def forget(self, session_id: str) -> None:
        """Hand them to nobody any more."""
        self._listeners.pop(session_id, None)

    async def _run(self) -> None:
        while True:
            try:
                async for event in self._source.events(start_block=self._next_block, names=NAMES):
                    self._next_block = event.block_number
                    self._hand_out(event)
            except LedgerError as error:
                _log.warning("the ledger's events stopped, once more in %g s: %s", _AGAIN_S, error)
            await asyncio.sleep(_AGAIN_S)

    def _hand_out(self, event: ContractEvent) -> None:
        session_id = event.record.get("session_id")
        if not isinstance(session_id, str):
            return
        listener = self._listeners.get(session_id)
        if listener is None:
            self._early[session_id] = event
            if len(self._early) > _REMEMBERED:
                self._early.popitem(last=False)
            return
        try:
            if event.name == "ProofCancelled":
                session = Session.parse(event.record)
                listener(on.SessionCancelled(session.ended_by or "", session.end or "cancelled", session.note or ""))
                return
            verdict = Verdict.parse(event.record)
        except ProofError as error:
            _log.warning("event %s of transaction %s cannot be read: %s", event.name, event.tx_id, error)
            return
        if verdict.permission != "granted":
            listener(on.VerdictCommitted(verdict, event.tx_id))
            return
        task = asyncio.create_task(self._hand_out_permission(verdict, event.tx_id), name="confirm a permission")
        self._confirming.add(task)
        task.add_done_callback(self._confirming.discard)

    async def _hand_out_permission(self, told: Verdict, tx_id: str) -> None:
        held = await self._held(told.session_id)
        listener = self._listeners.get(told.session_id)
        if held != told:
            _log.error(
                "transaction %s told of a permission that the ledger does not hold for session %s; not believed",
                tx_id,
                told.session_id,
            )
        elif listener is not None:
            listener(on.VerdictCommitted(held, tx_id))

    async def _held(self, session_id: str) -> Verdict | None:
        """The verdict that the ledger holds; None where it has none, or nobody could be asked in time."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._patience_s
        while True:
            try:
                verdict = await self._source.read_verdict(session_id)
            except LedgerError as error:
                _log.warning("the verdict of session %s cannot be read: %s", session_id, error)
                verdict = None
            if verdict is not None or loop.time() >= deadline_s:
                return verdict
            await asyncio.sleep(_PAUSE_S)
