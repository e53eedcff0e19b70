"""The thin shell around a session's machine: it hands in events and the time, and performs the actions."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Coroutine, Sequence
from typing import Final, Generic, Protocol, TypeVar

from wonderland.clock import Clock
from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.records.sessions import Session
from wonderland.session.actions import Cancel, Finish
from wonderland.session.events import Tick
from wonderland_fira_uci.errors import UwbError

_log = logging.getLogger(__name__)

CANCEL_PATIENCE_S: Final = 10.0
"""How long a session waits for its cancellation; after that the agent sees to it later."""
RETRY_FIRST_S: Final = 0.2
RETRY_MAX_S: Final = 3.0
_SHORTEST_WAIT_S: Final = 0.001

A = TypeVar("A")
E = TypeVar("E")
A_co = TypeVar("A_co", covariant=True)
E_contra = TypeVar("E_contra", contravariant=True)


class Machine(Protocol[A_co, E_contra]):
    """A session's state machine: events in, actions out, no I/O and no clock of its own."""

    @property
    def session(self) -> Session:
        """The session that it goes through."""
        ...

    def start(self, now_ms: int) -> Sequence[A_co]:
        """What is to be done first."""
        ...

    def handle(self, event: E_contra | Tick, now_ms: int) -> Sequence[A_co]:
        """What is to be done about something that happened."""
        ...

    def next_tick_ms(self) -> int | None:
        """When it wants to look at the clock."""
        ...

    def next_frames_ms(self) -> int | None:
        """When ``frames_to_send`` has something."""
        ...

    def frames_to_send(self, now_ms: int) -> list[bytes]:
        """Frames for one data unit of the node."""
        ...


class Speaker(Protocol):
    """The nodes of this side, as far as the shell needs them."""

    async def send(self, data: bytes) -> None:
        """Hand a data unit to the node that speaks; raises UwbError."""

    async def close_session(self) -> None:
        """Stop both UWB sessions; never raises."""


class Cancelling(Protocol):
    """The ledger, as far as the shell needs it; raises RefusedError and AwayError."""

    async def cancel(self, session_id: str, reason: str, note: str = "") -> tuple[Session, Committed]:
        """End a session without a verdict."""
        ...


class Pauses:
    """Pauses between tries that grow from RETRY_FIRST_S to RETRY_MAX_S."""

    def __init__(self) -> None:
        self._next_s = RETRY_FIRST_S

    async def pause(self) -> None:
        """Sleep for the next one."""
        await asyncio.sleep(self._next_s)
        self._next_s = min(RETRY_MAX_S, 2 * self._next_s)


class SessionRunner(Generic[A, E]):
    """Runs one session to its end; each side says how it performs its actions (``_perform``)."""

    def __init__(self, machine: Machine[A, E], *, speaker: Speaker, ledger: Cancelling, clock: Clock) -> None:
        self._steps = machine
        self._speaker = speaker
        self._cancelling = ledger
        self._clock = clock
        self._events: list[E | Tick] = []
        self._wake = asyncio.Event()
        self._frames_due = asyncio.Event()
        self._sending = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._finish: Finish | None = None

    @property
    def session(self) -> Session:
        """The session that runs here."""
        return self._steps.session

    def deliver(self, event: E | Tick) -> None:
        """Tell the session something: a report of a node, an event of the ledger."""
        self._events.append(event)
        self._wake.set()

    async def run(self) -> Finish:
        """Until the session has ended for this side; its last record says how."""
        frames = asyncio.create_task(self._send_frames())
        try:
            await self._perform_all(self._steps.start(self._clock()))
            while self._finish is None:
                await self._wait()
                events, self._events = self._events or [Tick()], []
                for event in events:
                    await self._perform_all(self._steps.handle(event, self._clock()))
                self._frames_due.set()
            return self._finish
        finally:
            tasks = (frames, *self._tasks)
            for task in tasks:
                task.cancel()
            for task in tasks:
                with contextlib.suppress(asyncio.CancelledError):
                    await task
            await self._speaker.close_session()

    async def _perform(self, action: A) -> None:
        raise NotImplementedError

    async def _perform_all(self, actions: Sequence[A]) -> None:
        for action in actions:
            await self._perform(action)

    async def _wait(self) -> None:
        """Until something happened or the machine or its link wants to look at the clock."""
        if not self._events:
            # While a frame waits for the node's credit, others are due all the time: do not spin meanwhile.
            frames_ms = None if self._sending else self._steps.next_frames_ms()
            times = [t_ms for t_ms in (self._steps.next_tick_ms(), frames_ms) if t_ms is not None]
            delay_s = max(_SHORTEST_WAIT_S, (min(times) - self._clock()) / 1000) if times else None
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(delay_s):
                    await self._wake.wait()
        self._wake.clear()

    async def _send_frames(self) -> None:
        while True:
            await self._frames_due.wait()
            self._frames_due.clear()
            while frames := self._steps.frames_to_send(self._clock()):
                self._sending = True
                try:
                    await self._speaker.send(b"".join(frames))
                except UwbError as error:
                    _log.debug("a frame was not sent and will be repeated: %s", error)
                    break
                finally:
                    self._sending = False
                    self.deliver(Tick())

    def _start(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        """Work beside the session; it is cancelled when the session ends."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _cancel(self, action: Cancel) -> str | None:
        """End the session on the ledger; the transaction, or None where the ledger is away or somebody ended it."""
        session_id = self.session.session_id
        try:
            async with asyncio.timeout(CANCEL_PATIENCE_S):
                _, done = await self._cancelling.cancel(session_id, action.reason, action.note)
        except (AwayError, TimeoutError) as error:
            _log.warning("session %.12s: not cancelled yet, the ledger is away: %s", session_id, error)
        except RefusedError as error:  # someone else ended it: the ledger says how
            _log.info("session %.12s: not cancelled: %s", session_id, error)
        else:
            return done.tx_id
        return None
