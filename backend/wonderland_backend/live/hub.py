"""The hub: one encoded frame per tick for all clients, a ring to resume from, a bounded queue per client."""

from __future__ import annotations

import asyncio
import logging
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

import orjson

from wonderland_backend.context import part
from wonderland_backend.live.board import Board
from wonderland_backend.live.lens import Lens

logger = logging.getLogger(__name__)

SNAPSHOT_PART_BYTES: Final = 128 * 1024
STATUS_EVERY_MS: Final = 1_000
HEARTBEAT_MS: Final = 2_000
"""So long at most nothing is sent: who hears nothing for three of them knows that the connection is dead."""
MAX_RING_FRAMES: Final = 5_000
LONGEST_PAUSE_S: Final = 2.0
"""So long a tick waits at most for sockets that cannot take what they were given."""

PACKED_FROM: Final = 1_024
"""Shorter frames go as text also to those who take packed ones, characters."""
PACKING_LEVEL: Final = 2
"""250 positions: a fifth is left after 0.3 ms; level 6 takes 1.0 ms and leaves 15 % less."""

TOO_SLOW: Final = 4408
SIGNED_OUT: Final = 4401
TOO_MANY: Final = 4429
GOING_AWAY: Final = 1001


@dataclass(eq=False)
class Client:
    """One live connection: frames that wait for it, and why it is to be closed."""

    person: str
    """Hash of the sign-in's cookie; empty: a part of this server."""
    limit_bytes: int
    lens: Lens | None = None
    """None: it sees the frames as they are."""
    takes_packed: bool = False
    """Long frames go to it as zlib's bytes, packed once for all who see the same."""
    frames: deque[str | bytes] = field(default_factory=deque)
    waiting_bytes: int = 0
    close_code: int | None = None
    closing: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when `close_code` is; a sender may be stuck in a socket that nobody reads."""
    _ready: asyncio.Event = field(default_factory=asyncio.Event)

    def offer(self, frame: str | bytes) -> None:
        """Queue a frame; a client that does not keep up is closed, never fed a part."""
        if self.close_code is not None:
            return
        if self.waiting_bytes + len(frame) > self.limit_bytes:
            self.close(TOO_SLOW)
            return
        self.frames.append(frame)
        self.waiting_bytes += len(frame)
        self._ready.set()

    def close(self, code: int) -> None:
        """End the connection with this code; what waits is not sent any more."""
        if self.close_code is None:
            self.close_code = code
            self.frames.clear()
            self.waiting_bytes = 0
            self.closing.set()
            self._ready.set()

    async def next_frame(self) -> str | bytes | None:
        """The next frame; None when the connection is to be closed."""
        while not self.frames:
            if self.close_code is not None:
                return None
            self._ready.clear()
            await self._ready.wait()
        frame = self.frames.popleft()
        self.waiting_bytes -= len(frame)
        return frame


class Hub:
    """All live connections."""

    def __init__(
        self,
        board: Board,
        *,
        epoch: str,
        clock: Callable[[], int],
        tick_ms: int,
        ring_bytes: int,
        client_queue_bytes: int,
        max_viewers: int,
    ) -> None:
        self.epoch: Final = epoch
        self.seq = 0
        self._board = board
        self._clock = clock
        self._tick_s = tick_ms / 1000
        self._ring: deque[tuple[int, str]] = deque()
        self._ring_bytes = 0
        self._max_ring_bytes = ring_bytes
        self._client_queue_bytes = client_queue_bytes
        self._max_viewers = max_viewers
        self._clients: set[Client] = set()
        self._snapshot: tuple[int, list[str]] | None = None
        self._status_due_ms = 0
        self._sent_ms = clock()
        self._closing = False
        self.frames = 0
        self.bytes = 0
        self.closed_slow = 0
        board.viewers = lambda: len(self._clients)

    async def run(self) -> None:
        """Send each tick's changes to every client, until cancelled."""
        loop = asyncio.get_running_loop()
        due = ticked = loop.time()
        while True:
            due = max(due + self._tick_s, loop.time())
            await asyncio.sleep(due - loop.time())
            if self._is_behind() and loop.time() < ticked + LONGEST_PAUSE_S:
                continue
            ticked = loop.time()
            try:
                self.tick()
            except Exception:
                # One change that cannot be shown must not silence all that follow.
                logger.exception("a live frame was lost")

    def _is_behind(self) -> bool:
        """Whether most clients have not begun with the last frame: then it is this server that cannot send as much.

        One client that reads slowly is closed when its queue is full. But where all would be, positions wait: they are
        coalesced meanwhile, so that fewer and newer ones are sent.
        """
        return 2 * sum(1 for client in self._clients if client.frames) > len(self._clients)

    def tick(self) -> None:
        """Send what changed since the last tick, encoded once; after a silence a delta that says only its time."""
        now = self._clock()
        with_status = now >= self._status_due_ms or now < self._status_due_ms - STATUS_EVERY_MS
        if with_status:
            self._status_due_ms = now + STATUS_EVERY_MS
        changed = self._board.take_changes(with_status=with_status)
        if not changed and 0 <= now - self._sent_ms < HEARTBEAT_MS:
            return
        self._sent_ms = now
        self.seq += 1
        frame = orjson.dumps({"type": "delta", "seq": self.seq, "t_ms": now, **changed}).decode()
        self._remember(frame)
        views = _Views(frame)
        for client in self._clients:
            view = views.of(client)
            client.offer(view)
            if client.close_code == TOO_SLOW:
                self.closed_slow += 1
            else:
                self.bytes += len(view)
        self._clients = {client for client in self._clients if client.close_code is None}
        self.frames += len(self._clients)

    def join(
        self, person: str, since: tuple[str, int] | None, lens: Lens | None = None, *, takes_packed: bool = False
    ) -> tuple[Client, Iterator[str | bytes]]:
        """A new connection: what to send it first, at its own pace; its queue has what comes after that.

        `since` (epoch, seq) is what it has seen already.
        """
        client = Client(person, self._client_queue_bytes, lens, takes_packed)
        if self._closing or len(self._clients) >= self._max_viewers:
            client.close(GOING_AWAY if self._closing else TOO_MANY)
            return client, iter(())
        self.tick()  # so that the snapshot is the state at `seq`, and nothing comes twice
        self._clients.add(client)
        epoch = self.epoch if lens is None else lens.epoch(self.epoch)
        missed = self._missed(since, epoch)
        hello = {
            "type": "hello",
            "epoch": epoch,
            "seq": self.seq,
            "t_ms": self._clock(),
            "resumed": missed is not None,
        }
        frames = self._parts() if missed is None else missed
        return client, self._first(orjson.dumps(hello).decode(), frames, client)

    def leave(self, client: Client) -> None:
        """A connection has ended."""
        self._clients.discard(client)

    def close_person(self, person: str) -> None:
        """Close all connections of a sign-in that has ended."""
        for client in [each for each in self._clients if each.person == person]:
            client.close(SIGNED_OUT)
            self._clients.discard(client)

    def restart_person(self, person: str) -> None:
        """Close all connections of a sign-in that may see something else now; the client comes back at once."""
        for client in [each for each in self._clients if each.person == person]:
            client.close(GOING_AWAY)
            self._clients.discard(client)

    def people(self) -> set[str]:
        """The sign-ins that have connections."""
        return {client.person for client in self._clients if client.person}

    def close(self) -> None:
        """Close all connections: the server stops."""
        self._closing = True
        for client in self._clients:
            client.close(GOING_AWAY)
        self._clients.clear()

    def __len__(self) -> int:
        return len(self._clients)

    @staticmethod
    def _first(hello: str, frames: list[str], client: Client) -> Iterator[str | bytes]:
        yield hello
        for frame in frames:
            yield _Views(frame).of(client)

    def _remember(self, frame: str) -> None:
        self._ring.append((self.seq, frame))
        self._ring_bytes += len(frame)
        while self._ring and (self._ring_bytes > self._max_ring_bytes or len(self._ring) > MAX_RING_FRAMES):
            _, oldest = self._ring.popleft()
            self._ring_bytes -= len(oldest)

    def _missed(self, since: tuple[str, int] | None, epoch: str) -> list[str] | None:
        """The frames after `since`, or None when the ring does not reach back so far."""
        if since is None or since[0] != epoch or since[1] > self.seq:
            return None
        missed = [frame for seq, frame in self._ring if seq > since[1]]
        if len(missed) != self.seq - since[1] or sum(map(len, missed)) > self._client_queue_bytes:
            return None
        return missed

    def _parts(self) -> list[str]:
        """The snapshot as frames of bounded size; encoded once for all who join at the same `seq`."""
        if self._snapshot is not None and self._snapshot[0] == self.seq:
            return self._snapshot[1]
        parts: list[dict[str, list[bytes]]] = [{}]
        size = 0
        for kind, items in self._board.snapshot().items():
            for item in items:
                encoded = orjson.dumps(item)
                if size and size + len(encoded) > SNAPSHOT_PART_BYTES:
                    parts.append({})
                    size = 0
                parts[-1].setdefault(kind, []).append(encoded)
                size += len(encoded) + 1
        frames = [self._part(index, len(parts), part) for index, part in enumerate(parts, start=1)]
        self._snapshot = (self.seq, frames)
        return frames

    def _part(self, index: int, of: int, part: dict[str, list[bytes]]) -> str:
        content: dict[str, Any] = {"type": "snapshot", "part": index, "of": of}
        for kind, items in part.items():
            content[kind] = [orjson.Fragment(item) for item in items]
        if index == 1:
            content["status"] = self._board.status()
            if self._board.has_more_alerts:
                content["alerts_more"] = True
        return orjson.dumps(content).decode()


HubDep = Annotated[Hub, part(Hub)]


class _Views:
    """One frame as different clients get it; each view is made once for all who share it."""

    def __init__(self, frame: str) -> None:
        self._frame = frame
        self._seen: dict[str, str] = {}
        self._packed: dict[str, bytes] = {}

    def of(self, client: Client) -> str | bytes:
        key = "" if client.lens is None else client.lens.key
        frame = self._seen.get(key)
        if frame is None:
            frame = self._seen[key] = self._frame if client.lens is None else client.lens.frame(self._frame)
        if not client.takes_packed or len(frame) < PACKED_FROM:
            return frame
        packed = self._packed.get(key)
        if packed is None:
            packed = self._packed[key] = zlib.compress(frame.encode(), PACKING_LEVEL)
        return packed
