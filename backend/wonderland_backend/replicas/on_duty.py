"""What the backend on duty does for those that follow: tells frames, says its state when asked, does their requests."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

from starlette.types import ASGIApp

from wonderland_backend.live.board import Board
from wonderland_backend.live.hub import Frame, Hub
from wonderland_backend.replicas import keys
from wonderland_backend.replicas.asgi import done_by
from wonderland_backend.replicas.messages import Request, State, Told, Wanted, decode, encode, packed

if TYPE_CHECKING:
    from wonderland_backend.replicas.bus import Bus

logger = logging.getLogger(__name__)

MOST_WAITING: Final = 100
"""Frames that wait for the bus; what comes while it takes none is lost there, and asked for afterwards."""


class OnDuty:
    """From the moment at which this backend is on duty to its end."""

    def __init__(self, bus: Bus, instance: str, hub: Hub, board: Board, app: ASGIApp) -> None:
        self._bus = bus
        self._hub = hub
        self._board = board
        self._app = app
        self._epoch = hub.epoch
        self._frames: asyncio.Queue[Frame] = asyncio.Queue(MOST_WAITING)
        self._key = keys.frames(instance)
        hub.tell = self._tell
        bus.answer(keys.state(instance, self._epoch), self._state)
        bus.answer(keys.requests(instance, self._epoch), self._request)

    async def run(self) -> None:
        """Tell the frames, until cancelled."""
        while True:
            frame = await self._frames.get()
            try:
                await self._bus.put(self._key, encode(Told.of(self._epoch, frame)))
            except Exception:
                logger.exception("a frame could not be told to other backends")

    def _tell(self, frame: Frame) -> None:
        if not self._frames.full():
            self._frames.put_nowait(frame)

    async def _state(self, data: bytes) -> bytes:
        wanted: Wanted = decode(Wanted, data)
        hub = self._hub
        hub.tick()
        missed = hub.missed((wanted.epoch, wanted.seq))
        if missed is not None:
            told = [Told.of(self._epoch, frame) for frame in missed]
            return encode(State(self._epoch, hub.seq, told, [], self._board.owners()))
        parts = [packed(part) for part in hub.parts()]
        return encode(State(self._epoch, hub.seq, None, parts, self._board.owners()))

    async def _request(self, data: bytes) -> bytes:
        request: Request = decode(Request, data)
        return encode(await done_by(self._app, request))
