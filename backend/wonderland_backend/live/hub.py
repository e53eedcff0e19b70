"""The hub: one encoded frame per tick for all clients, a ring to resume from, a bounded queue per client."""

from __future__ import annotations

import asyncio
import logging
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Annotated, Any, Final, Protocol

import orjson

from wonderland_backend.context import part
from wonderland_backend.live.aside import Aside
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
    first: Iterator[str | bytes] = field(default_factory=lambda: iter(()))
    """What it is sent before what waits: the beginning, made as it takes it."""
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

    def begin(self, first: Iterator[str | bytes]) -> None:
        """It begins (anew) with these frames; what waits is not sent any more."""
        self.first = first
        self.frames.clear()
        self.waiting_bytes = 0
        self._ready.set()

    def close(self, code: int) -> None:
        """End the connection with this code; what waits is not sent any more."""
        if self.close_code is None:
            self.close_code = code
            self.begin(iter(()))
            self.closing.set()

    async def next_frame(self) -> str | bytes | None:
        """The next frame; None when the connection is to be closed."""
        while self.close_code is None:
            beginning = next(self.first, None)
            if beginning is not None:
                await asyncio.sleep(0)  # a long beginning is not sent at one go
                return beginning
            if self.frames:
                frame = self.frames.popleft()
                self.waiting_bytes -= len(frame)
                return frame
            self._ready.clear()
            await self._ready.wait()
        return None


@dataclass(frozen=True, slots=True)
class Frame:
    """What all clients are sent at one tick, and what other backends are told beside it."""

    seq: int
    text: str
    aside: Aside


class Shown(Protocol):
    """What clients are shown: this backend's own board, or the copy of another's."""

    has_more_alerts: bool
    viewers: Callable[[], int]

    def snapshot(self) -> dict[str, list[Any]]:
        """All that a client needs to begin, by kind."""

    def status(self) -> dict[str, Any]:
        """The Status of the interfaces."""

    def pad_owner(self, pad_id: str) -> str | None:
        """Whose pad it is on the ledger."""

    def drone_owner(self, uav_id: str) -> str | None:
        """Whose drone it is on the ledger."""

    def is_connected(self, pad_id: str) -> bool:
        """Whether this pad's agent is connected."""


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
        self.epoch = epoch
        self.seq = 0
        self.board: Shown = board
        self.tell: Callable[[Frame], None] = lambda _frame: None
        """Told of each frame, before clients are."""
        self._own: Board | None = board
        self._ended: dict[str, int] = {}
        self._clock = clock
        self._tick_s = tick_ms / 1000
        self._ring: deque[Frame] = deque()
        self._ring_bytes = 0
        self._max_ring_bytes = ring_bytes
        self._client_queue_bytes = client_queue_bytes
        self._max_viewers = max_viewers
        self._clients: set[Client] = set()
        self._snapshot: tuple[int, list[_Views]] | None = None
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
        """Send what changed since the last tick, encoded once; after a silence a delta that says only its time.

        Of another's frames nothing is to be made here.
        """
        board = self._own
        if board is None:
            return
        now = self._clock()
        with_status = now >= self._status_due_ms or now < self._status_due_ms - STATUS_EVERY_MS
        if with_status:
            self._status_due_ms = now + STATUS_EVERY_MS
        changed = board.take_changes(with_status=with_status)
        aside = board.take_aside()
        aside.people, self._ended = self._ended, {}
        if not changed and aside.is_empty and 0 <= now - self._sent_ms < HEARTBEAT_MS:
            return
        self._sent_ms = now
        text = orjson.dumps({"type": "delta", "seq": self.seq + 1, "t_ms": now, **changed}).decode()
        self.relay(Frame(self.seq + 1, text, aside))

    def relay(self, frame: Frame) -> None:
        """Send a frame to every client: the next one of this epoch, made here or by the backend that is followed."""
        self.seq = frame.seq
        self._remember(frame)
        self.tell(frame)
        self._offer(frame.text)

    def say(self, changed: dict[str, Any]) -> None:
        """Tell clients something that is no part of the frames: it has the last one's number, and nobody resumes it."""
        self._offer(orjson.dumps({"type": "delta", "seq": self.seq, "t_ms": self._clock(), **changed}).decode())

    def begin(self, epoch: str, seq: int, board: Shown) -> None:
        """From here on this is shown; all clients begin anew with it, on the connections that they have.

        Frames are made here where it is a board of our own, and relayed where it is a copy.
        """
        self.epoch, self.seq, self.board = epoch, seq, board
        self._own = board if isinstance(board, Board) else None
        board.viewers = lambda: len(self._clients)
        self._ring.clear()
        self._ring_bytes = 0
        self._snapshot = None
        self._sent_ms = self._status_due_ms = 0  # whoever follows is told at the next tick
        for client in self._clients:
            client.begin(self._first(None, client))

    def _offer(self, text: str) -> None:
        views = _Views(text)
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
    ) -> Client:
        """A new connection: it is sent the beginning first, at its own pace, then what comes after that.

        `since` (epoch, seq) is what it has seen already.
        """
        client = Client(person, self._client_queue_bytes, lens, takes_packed)
        if self._closing or len(self._clients) >= self._max_viewers:
            client.close(GOING_AWAY if self._closing else TOO_MANY)
            return client
        self.tick()  # so that the snapshot is the state at `seq`, and nothing comes twice
        self._clients.add(client)
        client.begin(self._first(since, client))
        return client

    def missed(self, since: tuple[str, int] | None) -> list[Frame] | None:
        """The frames after `since` (epoch, seq), or None when the ring does not reach back so far."""
        if since is None or since[0] != self.epoch or since[1] > self.seq:
            return None
        missed = [frame for frame in self._ring if frame.seq > since[1]]
        if len(missed) != self.seq - since[1] or sum(len(each.text) for each in missed) > self._client_queue_bytes:
            return None
        return missed

    def parts(self) -> list[str]:
        """The snapshot as of now, as frames of bounded size."""
        self.tick()
        return [views.text for views in self._parts()]

    def pad_owner(self, pad_id: str) -> str | None:
        """Whose pad it is on the ledger, as what is shown has it."""
        return self.board.pad_owner(pad_id)

    def drone_owner(self, uav_id: str) -> str | None:
        """Whose drone it is on the ledger, as what is shown has it."""
        return self.board.drone_owner(uav_id)

    def leave(self, client: Client) -> None:
        """A connection has ended."""
        self._clients.discard(client)

    def close_person(self, person: str) -> None:
        """Close all connections of a sign-in that has ended."""
        self.end_person(person, SIGNED_OUT)

    def restart_person(self, person: str) -> None:
        """Close all connections of a sign-in that may see something else now; the client comes back at once."""
        self.end_person(person, GOING_AWAY)

    def end_person(self, person: str, code: int) -> None:
        """Close its connections here, and have other backends do the same."""
        if self._own is not None:
            self._ended[person] = code
        for client in [each for each in self._clients if each.person == person]:
            client.close(code)
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

    def _first(self, since: tuple[str, int] | None, client: Client) -> Iterator[str | bytes]:
        """The beginning as of now, made into this client's view as it is taken."""
        lens = client.lens
        epoch = self.epoch if lens is None else lens.epoch(self.epoch)
        # Who has seen an epoch through a lens knows it by another name.
        missed = None if since is None or since[0] != epoch else self.missed((self.epoch, since[1]))
        resumed = missed is not None
        hello = {"type": "hello", "epoch": epoch, "seq": self.seq, "t_ms": self._clock(), "resumed": resumed}
        views = self._parts() if missed is None else [_Views(each.text) for each in missed]
        return chain([orjson.dumps(hello).decode()], (each.of(client) for each in views))

    def _remember(self, frame: Frame) -> None:
        self._ring.append(frame)
        self._ring_bytes += len(frame.text)
        while self._ring and (self._ring_bytes > self._max_ring_bytes or len(self._ring) > MAX_RING_FRAMES):
            self._ring_bytes -= len(self._ring.popleft().text)

    def _parts(self) -> list[_Views]:
        """The snapshot in parts; encoded, and each view of it made, once for all who begin at the same `seq`."""
        if self._snapshot is not None and self._snapshot[0] == self.seq:
            return self._snapshot[1]
        parts: list[dict[str, list[bytes]]] = [{}]
        size = 0
        for kind, items in self.board.snapshot().items():
            for item in items:
                encoded = orjson.dumps(item)
                if size and size + len(encoded) > SNAPSHOT_PART_BYTES:
                    parts.append({})
                    size = 0
                parts[-1].setdefault(kind, []).append(encoded)
                size += len(encoded) + 1
        frames = [_Views(self._part(index, len(parts), part)) for index, part in enumerate(parts, start=1)]
        self._snapshot = (self.seq, frames)
        return frames

    def _part(self, index: int, of: int, part: dict[str, list[bytes]]) -> str:
        content: dict[str, Any] = {"type": "snapshot", "part": index, "of": of}
        for kind, items in part.items():
            content[kind] = [orjson.Fragment(item) for item in items]
        if index == 1:
            content["status"] = self.board.status()
            if self.board.has_more_alerts:
                content["alerts_more"] = True
        return orjson.dumps(content).decode()


HubDep = Annotated[Hub, part(Hub)]


class _Views:
    """One frame as different clients get it; each view is made once for all who share it."""

    def __init__(self, text: str) -> None:
        self.text: Final = text
        self._seen: dict[str, str] = {}
        self._packed: dict[str, bytes] = {}

    def of(self, client: Client) -> str | bytes:
        key = "" if client.lens is None else client.lens.key
        frame = self._seen.get(key)
        if frame is None:
            frame = self._seen[key] = self.text if client.lens is None else client.lens.frame(self.text)
        if not client.takes_packed or len(frame) < PACKED_FROM:
            return frame
        packed = self._packed.get(key)
        if packed is None:
            packed = self._packed[key] = zlib.compress(frame.encode(), PACKING_LEVEL)
        return packed
