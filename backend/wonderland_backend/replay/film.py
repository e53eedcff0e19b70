"""The past played on a live board: the state at a moment, and the frames that a live client would have got."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any, Final

import orjson

from wonderland_backend.context import Context
from wonderland_backend.live.board import Board
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.person import Person
from wonderland_backend.replay.queries.events import Span, events
from wonderland_backend.replay.queries.moment import Moment, connected_at, contents_at, moment

SLICE_STEPS: Final = 10
"""So many steps are read from the database at a time."""
MAX_STEPS: Final = 3_000
MAX_BYTES: Final = 24 << 20
"""A film that would be longer ends early, and says how far it came."""
STATUS_EVERY_MS: Final = 1_000
EPOCH: Final = "replay"
_THEN: Final = "then"


class PastAgents:
    """Which pads' agents were connected, for a board to ask."""

    def __init__(self, pad_ids: set[str]) -> None:
        self._connections = {(pad_id, _THEN) for pad_id in pad_ids}

    def is_connected(self, pad_id: str) -> bool:
        """Whether this pad's agent was connected."""
        return any(known == pad_id for known, _ in self._connections)

    def change(self, pad_id: str, server: str, *, connected: bool) -> None:
        """It came to a server, or went."""
        if connected:
            self._connections.add((pad_id, server))
        else:
            # One that stood at the beginning may have been to any server.
            self._connections -= {(pad_id, server), (pad_id, _THEN)}

    def __len__(self) -> int:
        return len({pad_id for pad_id, _ in self._connections})


@dataclass
class Stage:
    """A board at a moment of the past, and what it looks at."""

    board: Board
    mirror: MirrorStatus
    agents: PastAgents
    now_ms: int

    def reach_block(self, number: int) -> None:
        """The ledger is known as far as this block."""
        self.mirror.height = self.mirror.mirrored = number + 1

    def connect(self, pad_id: str, server: str, *, connected: bool) -> None:
        """A pad's agent came to a server, or went."""
        self.agents.change(pad_id, server, connected=connected)
        self.board.connection_changed(pad_id)


async def stage_at(context: Context, now: MirrorStatus, t_ms: int, person: Person) -> tuple[Moment, Stage]:
    """The board as it was at a time (ms since the Unix epoch), for this person."""
    async with context.database.read() as database:
        when = await moment(database, t_ms)
        contents = await contents_at(database, when, person)
        connected = await connected_at(database, t_ms)
    mirror = MirrorStatus(
        kind=now.kind,
        notice=now.notice,
        channel=now.channel,
        height=when.block + 1,
        mirrored=when.block + 1,
        connected=True,
        organisations=now.organisations,
        level_ms=t_ms,
    )
    agents = PastAgents(connected.intersection(pad_id for pad_id, *_ in contents.pads))
    board = Board(
        mirror=mirror,
        agents=agents,
        clock=lambda: stage.now_ms,
        version=context.version,
        epoch=EPOCH,
        demo=context.settings.demo,
    )
    stage = Stage(board, mirror, agents, t_ms)
    board.fill(contents)
    return when, stage


async def frames(
    context: Context, now: MirrorStatus, person: Person, *, from_ms: int, until_ms: int, step_ms: int, snapshot: bool
) -> AsyncIterator[bytes]:
    """Frames of the live interface, one a line.

    A hello and a snapshot (both left out where a film is continued), a delta for each step in which something changed,
    and last ``{"type": "end", "t_ms", "complete"}``: how far it came.
    """
    _, stage = await stage_at(context, now, from_ms, person)
    if snapshot:
        yield _line(type="hello", epoch=EPOCH, seq=0, t_ms=from_ms, resumed=False)
        yield _line(type="snapshot", part=1, of=1, **stage.board.snapshot(), status=stage.board.status())
    sent = seq = 0
    status_ms = from_ms
    at_ms = from_ms
    while at_ms < until_ms and sent < MAX_BYTES:
        end_ms = min(until_ms, at_ms + SLICE_STEPS * step_ms)
        async with context.database.read() as database:
            coming = iter(await events(database, Span(at_ms, end_ms, step_ms), person))
        following = next(coming, None)
        while at_ms < end_ms:
            at_ms = stage.now_ms = min(end_ms, at_ms + step_ms)
            while following is not None and following.t_ms <= at_ms:
                following.apply(stage)
                following = next(coming, None)
            with_status = at_ms - status_ms >= STATUS_EVERY_MS
            if with_status:
                status_ms = at_ms
            changed = stage.board.take_changes(with_status=with_status)
            if changed:
                seq += 1
                line = _line(type="delta", seq=seq, t_ms=at_ms, **changed)
                sent += len(line)
                yield line
    yield _line(type="end", t_ms=at_ms, complete=at_ms >= until_ms)


def _line(**content: Any) -> bytes:
    return orjson.dumps(content, option=orjson.OPT_APPEND_NEWLINE)
