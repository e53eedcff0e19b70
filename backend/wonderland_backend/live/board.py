"""The present in memory: pads, positions, sessions under way, the last verdicts; and what changed since the last look.

Filled from the database at the start, then by the mirror and by what agents report. Whatever is shown once as JSON is
kept as JSON.
"""

from __future__ import annotations

import contextlib
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final, Protocol

import orjson
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.errors import ProofError
from wonderland.proofs.queue import LONGEST_MS
from wonderland.proofs.queue_book import QueueBook
from wonderland.proofs.records.reservations import Reservations
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import OUTCOMES
from wonderland_backend.alerts import store as alerts
from wonderland_backend.context import part
from wonderland_backend.live.aside import Aside
from wonderland_backend.live.queries import LAST_VERDICTS, MAX_TRACKS, RECENT_SESSIONS, Contents, contents_now
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.rows import (
    DroneWrite,
    EvidenceWrite,
    PadWrite,
    ReservationsWrite,
    SessionWrite,
    VerdictWrite,
    outline_of,
)
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.pads import queries as pads
from wonderland_backend.pads.queue import summary
from wonderland_backend.responses import record
from wonderland_backend.sessions.state import ReportedStep, SessionView

TRACK_AGE_MS: Final = 10 * 60_000
"""Older positions are not part of a snapshot; REST has them."""
HEARD_MS: Final = 60_000
EARLY_STEPS: Final = 2_000
"""Sessions whose steps may arrive before the mirror has the session."""


class Connected(Protocol):
    """Which agents are connected."""

    def is_connected(self, pad_id: str) -> bool:
        """Whether this pad's agent is."""

    def __len__(self) -> int: ...


@dataclass(slots=True)
class _Pad:
    msp_id: str
    record: str
    health: str | None = None


class Board:
    """What is now. Everything here runs on the event loop's thread, without awaiting in the middle of a change."""

    def __init__(
        self, *, mirror: MirrorStatus, agents: Connected, clock: Callable[[], int], version: str, epoch: str, demo: bool
    ) -> None:
        self._mirror = mirror
        self._agents = agents
        self._clock = clock
        self._server = {"version": version, "epoch": epoch, "demo": demo}
        self.viewers: Callable[[], int] = lambda: 0
        self._owners: dict[str, str] = {}
        self._aside = Aside()
        self._clear()

    def _clear(self) -> None:
        self._pads: dict[str, _Pad] = {}
        self._drones: set[str] = set()
        self._tracks: OrderedDict[str, tuple[int, orjson.Fragment]] = OrderedDict()
        self._estimates: dict[str, tuple[str, orjson.Fragment]] = {}
        self._sessions: OrderedDict[str, SessionView] = OrderedDict()
        self._queues: dict[str, QueueBook] = {}
        self._early: OrderedDict[str, list[ReportedStep]] = OrderedDict()
        self._verdicts: deque[Any] = deque(maxlen=LAST_VERDICTS)
        self._counts = dict.fromkeys(("sessions", *OUTCOMES), 0)
        self._changed_pads: set[str] = set()
        self._changed_tracks: dict[str, orjson.Fragment] = {}
        self._changed_estimates: dict[str, orjson.Fragment] = {}
        self._changed_sessions: list[Any] = []
        self._new_verdicts: list[Any] = []
        self._alerts: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._changed_alerts: list[dict[str, Any]] = []
        self.has_more_alerts = False
        """Whether more are open than are here."""
        self._shown_status: dict[str, Any] | None = None

    async def load(self, database: AsyncSession) -> None:
        """Fill from the database."""
        self.fill(await contents_now(database, self._clock()))

    def fill(self, contents: Contents) -> None:
        """Show this, and nothing else."""
        self._clear()
        for pad_id, msp_id, pad, health in contents.pads:
            self._pads[pad_id] = _Pad(msp_id, pad, health)
        self._drones = contents.drones
        self._owners = contents.owners
        for uav_id, t_ms, body in contents.tracks:
            self._tracks[uav_id] = (t_ms, orjson.Fragment(body))
        for view in contents.sessions:
            self._sessions[view.session_id] = view
        sessions, permitted = contents.queueing
        for session in sessions:
            self._book_of(session.pad_id).put(session)
        for pad_id, kept in contents.reservations.items():
            self._book_of(pad_id).reserved(kept)
        for book in self._queues.values():
            for session_id in permitted:
                book.permitted(session_id)
        for uav_id, session_id, body in contents.estimates:
            self._estimates[uav_id] = (session_id, orjson.Fragment(body))
        self._verdicts.extend(contents.verdicts)
        for alert in contents.alerts:
            self._alerts[alert["alert_id"]] = alert
        self.has_more_alerts = len(self._alerts) >= alerts.MAX_OPEN
        self._counts.update(contents.counts)

    def commit(self, changes: Changes) -> None:
        """Take in what the mirror has committed."""
        self._aside.committed = True
        self._aside.organisations |= changes.organisations is not None
        for pad in changes.rows(PadWrite).values():
            self._put_pad(pad)
        for drone in changes.rows(DroneWrite).values():
            self._drones.add(drone.uav_id)
            self._owners[drone.uav_id] = self._aside.drones[drone.uav_id] = drone.msp_id
        decided = {row.session_id: row for row in changes.verdict_writes}
        steps = {row.session_id: row.steps for row in changes.rows(EvidenceWrite).values()}
        for session in changes.session_writes:
            self._put_session(session, decided.get(session.session_id), steps.get(session.session_id))
            self._queue(session, decided.get(session.session_id))
        for row in changes.rows(ReservationsWrite).values():
            self._kept(row)
        self._forget_sessions()
        for verdict in changes.verdict_writes:
            shown = record(verdict.record, tx_id=verdict.tx_id, block=verdict.block, tx_index=verdict.tx_index)
            self._verdicts.append(shown)
            self._new_verdicts.append(shown)
            self._counts[verdict.outcome] = self._counts.get(verdict.outcome, 0) + 1

    def alert(self, shown: dict[str, Any]) -> None:
        """An alert that is new, or has changed."""
        self._changed_alerts.append(shown)
        if shown["state"] in alerts.WAITING:
            self._alerts[shown["alert_id"]] = shown
            while len(self._alerts) > alerts.MAX_OPEN:
                self._alerts.popitem(last=False)
                self.has_more_alerts = True
        else:
            self._alerts.pop(shown["alert_id"], None)

    def hear(self, uav_id: str, t_ms: int, body: str) -> None:
        """A position that a pad heard; an older one than is known changes nothing."""
        known = self._tracks.get(uav_id)
        if known is not None and known[0] > t_ms:
            return
        fragment = orjson.Fragment(body)
        self._tracks[uav_id] = (t_ms, fragment)
        self._tracks.move_to_end(uav_id)
        while len(self._tracks) > MAX_TRACKS:
            self._tracks.popitem(last=False)
        self._changed_tracks[uav_id] = fragment

    def estimate(self, uav_id: str, session_id: str, pad_id: str, body: str) -> None:
        """A pad's running estimate; only of a session of its own that is under way."""
        view = self._sessions.get(session_id)
        if view is not None and (view.outline.state != "requested" or view.outline.pad_id != pad_id):
            return
        fragment = orjson.Fragment(body)
        self._estimates[uav_id] = (session_id, fragment)
        while len(self._estimates) > MAX_TRACKS:
            del self._estimates[next(iter(self._estimates))]
        self._changed_estimates[uav_id] = fragment

    def step(self, session_id: str, step: ReportedStep) -> None:
        """A step that an agent reported; it may come before the mirror knows the session."""
        view = self._sessions.get(session_id)
        if view is None:
            self._early.setdefault(session_id, []).append(step)
            while len(self._early) > EARLY_STEPS:
                self._early.popitem(last=False)
            return
        view.report([step])
        self._changed_sessions.append(view.to_json())

    def health(self, pad_id: str, body: str) -> None:
        """A pad's word on its health."""
        pad = self._pads.get(pad_id)
        if pad is not None:
            pad.health = body
            self._changed_pads.add(pad_id)

    def connection_changed(self, pad_id: str) -> None:
        """A pad's agent came or went."""
        if pad_id in self._pads:
            self._changed_pads.add(pad_id)

    def status(self) -> dict[str, Any]:
        """The Status of the interfaces."""
        now = self._clock()
        outcomes = {outcome: self._counts.get(outcome, 0) for outcome in OUTCOMES}
        counts = {
            "pads": len(self._pads),
            "pads_connected": sum(1 for pad_id in self._pads if self._agents.is_connected(pad_id)),
            "drones": len(self._drones),
            "tracks": self._heard_since(now - HEARD_MS),
            "sessions": self._counts["sessions"],
            "verdicts": sum(outcomes.values()),
            **outcomes,
            "agents": len(self._agents),
            "viewers": self.viewers(),
        }
        return {"ledger": self._mirror.to_json(now), "server": self._server, "counts": counts}

    def pad_owner(self, pad_id: str) -> str | None:
        """Whose pad it is on the ledger."""
        pad = self._pads.get(pad_id)
        return None if pad is None else pad.msp_id

    def drone_owner(self, uav_id: str) -> str | None:
        """Whose drone it is on the ledger."""
        return self._owners.get(uav_id)

    def is_connected(self, pad_id: str) -> bool:
        """Whether this pad's agent is connected."""
        return self._agents.is_connected(pad_id)

    def owners(self) -> Aside:
        """Whose everything is, for a copy that begins."""
        return Aside(pads={pad_id: pad.msp_id for pad_id, pad in self._pads.items()}, drones=dict(self._owners))

    def take_aside(self) -> Aside:
        """What copies of this board must know beside the changes."""
        taken, self._aside = self._aside, Aside()
        return taken

    def snapshot(self) -> dict[str, list[Any]]:
        """All that a client needs to begin, by kind; verdicts oldest first."""
        oldest = self._clock() - TRACK_AGE_MS
        return {
            "pads": [self._shown_pad(pad_id) for pad_id in sorted(self._pads)],
            "sessions": [view.to_json() for view in self._sessions.values()],
            "verdicts": list(self._verdicts),
            "alerts": list(self._alerts.values()),
            "tracks": [fragment for t_ms, fragment in self._tracks.values() if t_ms >= oldest],
            "estimates": [fragment for _, fragment in self._estimates.values()],
        }

    def take_changes(self, *, with_status: bool) -> dict[str, Any]:
        """What changed since the last call; empty when nothing did. `with_status`: look whether the status did, too."""
        changed: dict[str, Any] = {}
        if self._changed_tracks:
            changed["tracks"] = list(self._changed_tracks.values())
            self._changed_tracks = {}
        if self._changed_estimates:
            changed["estimates"] = list(self._changed_estimates.values())
            self._changed_estimates = {}
        if self._changed_sessions:
            changed["sessions"] = self._changed_sessions
            self._changed_sessions = []
        if self._new_verdicts:
            changed["verdicts"] = self._new_verdicts
            self._new_verdicts = []
        if self._changed_alerts:
            changed["alerts"] = self._changed_alerts
            self._changed_alerts = []
        if self._changed_pads:
            changed["pads"] = [self._shown_pad(pad_id) for pad_id in sorted(self._changed_pads & self._pads.keys())]
            self._changed_pads = set()
        if with_status:
            status = self.status()
            if status != self._shown_status:
                changed["status"] = self._shown_status = status
        return changed

    def _put_pad(self, row: PadWrite) -> None:
        before = self._pads.get(row.pad_id)
        self._pads[row.pad_id] = _Pad(row.msp_id, row.record, None if before is None else before.health)
        self._changed_pads.add(row.pad_id)
        self._aside.pads[row.pad_id] = row.msp_id

    def _put_session(self, row: SessionWrite, verdict: VerdictWrite | None, evidence_steps: str | None) -> None:
        session_id = row.session_id
        outline = outline_of(row)
        view = self._sessions.get(session_id)
        if view is None:
            view = SessionView(outline)
            view.report(self._early.pop(session_id, ()))
            self._sessions[session_id] = view
        else:
            outline.keep(view.outline)
            view.outline = outline
        if row.state == "requested":
            self._counts["sessions"] += 1
        else:
            self._end_estimate(row.uav_id, session_id)
            view.take_evidence(evidence_steps)
            if verdict is not None:
                view.outcome, view.permission, view.rounds = verdict.outcome, verdict.permission, verdict.rounds
        self._changed_sessions.append(view.to_json())

    def _book_of(self, pad_id: str) -> QueueBook:
        return self._queues.setdefault(pad_id, QueueBook(pad_id))

    def _queue(self, row: SessionWrite, verdict: VerdictWrite | None) -> None:
        """Whoever asks, acts or leaves changes who waits for the pad; a ledger that is read anew tells of long ago."""
        now_ms = self._clock()
        if not row.record or max(row.expires_ms, row.ended_ms or 0) < now_ms - LONGEST_MS:
            return
        try:
            session = Session.decode(row.record)
        except ProofError:
            return  # of a later contract: it is in the list of sessions, and in nobody's way
        book = self._book_of(row.pad_id)
        book.put(session)
        if verdict is not None and verdict.permission == "granted":
            book.permitted(row.session_id)
        self._changed_pads.add(row.pad_id)

    def _kept(self, row: ReservationsWrite) -> None:
        with contextlib.suppress(ProofError):  # of a later contract
            self._book_of(row.pad_id).reserved(Reservations.decode(row.record))
            self._changed_pads.add(row.pad_id)

    def _forget_sessions(self) -> None:
        """Keep the recent ones, and of the older ones those that are not over, as long as they can still go on."""
        if len(self._sessions) <= RECENT_SESSIONS:
            return
        now = self._clock()
        for session_id, view in list(self._sessions.items()):
            if len(self._sessions) <= RECENT_SESSIONS:
                return
            if view.is_ended or view.outline.expires_ms < now or len(self._sessions) > 4 * RECENT_SESSIONS:
                del self._sessions[session_id]
                self._aside.gone.append(session_id)
                self._end_estimate(view.outline.uav_id, session_id)

    def _end_estimate(self, uav_id: str, session_id: str) -> None:
        known = self._estimates.get(uav_id)
        if known is not None and known[0] == session_id:
            del self._estimates[uav_id]

    def _shown_pad(self, pad_id: str) -> Any:
        pad = self._pads[pad_id]
        book = self._queues.get(pad_id)
        queue = None if book is None else summary(book.queue(self._clock()))
        return pads.pad_json(pad.record, pad.health, connected=self._agents.is_connected(pad_id), queue=queue)

    def _heard_since(self, t_ms: int) -> int:
        count = 0
        for heard_ms, _ in reversed(self._tracks.values()):
            if heard_ms < t_ms:
                break
            count += 1
        return count


BoardDep = Annotated[Board, part(Board)]
