"""A capture file in place of a receiver, at the pace at which it was recorded or faster: for a laboratory."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wonderland_edge_agent.receiver.errors import ReceiverError
from wonderland_remote_id.errors import RemoteIdError
from wonderland_remote_id.framings.captures import CaptureError, CaptureReader, Unwrapper

if TYPE_CHECKING:
    from wonderland_edge_agent.receiver.sources import Sink

CHUNK: Final = 1 << 16

_log = logging.getLogger(__name__)


class ReplaySource:
    """Plays a pcap or pcapng file once. ``speed`` 1 is its own pace, 0 as fast as it can be read.

    Frames are heard now: what they say of their own time is as old as the capture.
    """

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        self._path = path
        self._speed = speed
        self._task: asyncio.Task[None] | None = None
        self.finished = asyncio.Event()

    async def start(self, sink: Sink) -> None:
        """Begin to play. Raises `ReceiverError` when the file cannot be read."""
        try:
            with self._path.open("rb"):
                pass
        except OSError as cause:
            raise ReceiverError(f"remote_id.replay: {self._path}: {cause.strerror or cause}") from cause
        self._task = asyncio.create_task(self._play(sink))

    async def close(self) -> None:
        """Stop playing, wherever it is."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _play(self, sink: Sink) -> None:
        reader, unwrapper = CaptureReader(), Unwrapper()
        loop = asyncio.get_running_loop()
        began_s, first_ms = loop.time(), None
        try:
            with self._path.open("rb") as file:
                while data := await asyncio.to_thread(file.read, CHUNK):
                    for packet in reader.feed(data):
                        if packet.t_ms is not None and self._speed > 0:
                            first_ms = packet.t_ms if first_ms is None else first_ms
                            due_s = began_s + (packet.t_ms - first_ms) / 1000 / self._speed
                            if due_s > loop.time():
                                await asyncio.sleep(due_s - loop.time())
                        try:
                            found = unwrapper.frames(packet)
                        except RemoteIdError:
                            sink.take_bad()
                            continue
                        for one in found:
                            sink.take_framed(one, "replay")
                    await asyncio.sleep(0)
            reader.finish()
        except (CaptureError, OSError) as error:
            _log.error("Remote ID: %s: %s", self._path, error)
        else:
            _log.info("Remote ID: %s is played", self._path)
        self.finished.set()
