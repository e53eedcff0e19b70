"""A backend that is not on duty: it shows what the one on duty shows, and passes on what only that one can do."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, Final

import orjson

from wonderland_backend.live.aside import Aside
from wonderland_backend.live.copy import BoardCopy
from wonderland_backend.live.hub import HEARTBEAT_MS, Hub
from wonderland_backend.replicas import keys
from wonderland_backend.replicas.asgi import LONGEST_S
from wonderland_backend.replicas.messages import (
    Answer,
    Request,
    State,
    Told,
    UnansweredError,
    Wanted,
    decode,
    encode,
    unpacked,
)

if TYPE_CHECKING:
    from wonderland_backend.replicas.bus import Bus

logger = logging.getLogger(__name__)

STALE_MS: Final = 3 * HEARTBEAT_MS - 1_000
"""Something comes every two seconds; without two of these nothing is known any more."""
LOOK_S: Final = 1.0
STATE_S: Final = 5.0
MOST_WAITING: Final = 1_000
MOST_PASSED_ON: Final = 32
"""Requests at a time, each with its body in memory."""


class Follower:
    """Follows whoever is on duty, until cancelled. Consoles stay connected whoever that is."""

    def __init__(
        self,
        bus: Bus,
        instance: str,
        hub: Hub,
        copy: BoardCopy,
        *,
        holder: Callable[[], Awaitable[str]],
        noted: Callable[[dict[str, Any], Aside], Awaitable[None]],
        clock: Callable[[], int],
    ) -> None:
        """`holder`: the epoch of whoever is on duty, as the database knows it; `noted`: told of each frame."""
        self._bus = bus
        self._instance = instance
        self._hub = hub
        self._copy = copy
        self._holder = holder
        self._noted = noted
        self._clock = clock
        self._told: asyncio.Queue[Told] = asyncio.Queue(MOST_WAITING)
        self._epoch = ""
        self._heard_ms = clock()
        self._said_ms = 0
        self._under_way = 0
        self.passed_on = 0
        bus.listen(keys.frames(instance), self._hear)

    @property
    def is_stale(self) -> bool:
        """Whether nothing was heard of whoever is on duty for too long."""
        return not 0 <= self._clock() - self._heard_ms < STALE_MS

    def _hear(self, data: bytes) -> None:
        try:
            told: Told = decode(Told, data)
        except ValueError:
            logger.warning("something on the bus is no frame; do all backends have one version?")
            return
        if not self._told.full():  # else there is a gap, which is seen
            self._told.put_nowait(told)

    async def begin(self) -> None:
        """Begin where the one on duty is, if it says so at once."""
        await self._look()

    async def run(self) -> None:
        """Follow."""
        while True:
            try:
                async with asyncio.timeout(LOOK_S):
                    told = await self._told.get()
            except TimeoutError:
                await self._look()
                continue
            try:
                await self._take(told)
            except Exception:
                logger.exception("a frame of the backend on duty could not be shown")
                await asyncio.sleep(LOOK_S)

    async def _take(self, told: Told) -> None:
        if told.epoch != self._epoch:
            # Who says so must be who holds the database's lock: one that lost it may not know yet.
            if told.epoch == await self._holder():
                await self._catch_up(told.epoch)
            return
        if told.seq <= self._hub.seq:
            return
        if told.seq > self._hub.seq + 1:
            await self._catch_up(told.epoch)
            return
        await self._show(told)

    async def _show(self, told: Told) -> None:
        frame = told.frame()
        content = orjson.loads(frame.text)
        self._copy.apply(content, frame.aside)
        self._heard()
        self._hub.relay(frame)
        for person, code in frame.aside.people.items():
            self._hub.end_person(person, code)
        await self._noted(content, frame.aside)

    async def _catch_up(self, epoch: str) -> bool:
        """Ask for what was missed, or for everything. Whether it was answered."""
        wanted = Wanted(self._epoch, self._hub.seq)
        try:
            data = await self._bus.ask(keys.state(self._instance, epoch), encode(wanted), STATE_S)
            state: State = decode(State, data)
        except (UnansweredError, ValueError) as cause:
            logger.info("the backend on duty does not say where it is: %s", cause)
            return False
        if state.frames is not None:
            for told in state.frames:
                await self._show(told)
            self._heard()
            return True
        parts = [unpacked(part) for part in state.parts]
        self._copy.replace(parts, state.owners)
        self._epoch = state.epoch
        self._heard()
        self._hub.begin(state.epoch, state.seq, self._copy)
        everything = Aside(committed=True, organisations=True)
        await self._noted({"status": self._copy.status()}, everything)
        logger.info("follows the backend on duty from %s:%d on", state.epoch, state.seq)
        return True

    def _heard(self) -> None:
        self._heard_ms = self._clock()
        if self._copy.stale_since_ms is not None:
            self._copy.stale_since_ms = None
            self._hub.say({"status": self._copy.status()})

    async def _look(self) -> None:
        """Nothing came: find out who is on duty, and tell consoles where the picture is old."""
        now = self._clock()
        if self._epoch and not self.is_stale and now - self._heard_ms < HEARTBEAT_MS + 1_000:
            return
        try:
            holder = await self._holder()
        except Exception:
            logger.exception("who is on duty cannot be found out")
            holder = ""
        if holder and await self._catch_up(holder):
            return
        if self.is_stale and not 0 <= now - self._said_ms < HEARTBEAT_MS:
            self._said_ms = now
            self._copy.stale_since_ms = self._copy.stale_since_ms or self._heard_ms
            self._hub.say({"status": self._copy.status()})

    async def pass_on(self, request: Request) -> Answer:
        """Have it done by whoever is on duty. Raises `UnansweredError`."""
        if not self._epoch or self.is_stale:
            raise UnansweredError("nobody is known to be on duty", asked=False)
        if self._under_way >= MOST_PASSED_ON:
            raise UnansweredError("too much is passed on at once", asked=False)
        self._under_way += 1
        self.passed_on += 1
        try:
            key = keys.requests(self._instance, self._epoch)
            data = await self._bus.ask(key, encode(request), LONGEST_S + 5)
        finally:
            self._under_way -= 1
        answer: Answer = decode(Answer, data)
        return answer
