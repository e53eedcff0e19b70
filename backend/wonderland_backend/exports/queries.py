"""Reading what is exported, page by page: memory holds one page, and no transaction waits for a slow client."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any, Final

import orjson
from sqlalchemy import func, select, tuple_

from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.ledger import SessionRow, VerdictRow
from wonderland_backend.db.tables.reported import EstimateRow, LatestTrackRow, TrackMinuteRow, TrackRow
from wonderland_backend.exports.schemas import ExportQuery
from wonderland_backend.person import Scope
from wonderland_backend.tracks.queries import MAX_AHEAD_MS

PAGE: Final = 2_000
CLOCKS_MS: Final = 10 * 60_000
"""Estimates belong to sessions that were asked for at most so long before."""
TRACK_FIELDS: Final = (
    "uav_id", "t_ms", "pad_id", "lat_e7", "lon_e7", "height_mm", "accuracy_mm", "speed_mm_s", "track_cdeg",
    "vertical_mm_s", "status", "claim_t_ms", "transport", "rssi",
)  # fmt: skip
ESTIMATE_FIELDS: Final = (
    "uav_id", "t_ms", "pad_id", "session_id", "lat_e7", "lon_e7", "east_mm", "north_mm", "ee_mm2", "en_mm2", "nn_mm2",
    "rounds", "likelihood_ppm",
)  # fmt: skip

Record = dict[str, Any]


class Rows:
    """What a query finds, within a scope."""

    def __init__(self, database: Database, scope: Scope, query: ExportQuery) -> None:
        self._database = database
        self._scope = scope
        self._query = query

    async def expected(self) -> int:
        """About how many rows there are: positions by the minute, and those of the ledger."""
        query = self._query
        async with self._database.read() as database:
            if query.drone is not None:
                counted = select(func.count()).select_from(TrackRow).where(*self._positions(query.drone))
                counted = self._scope.narrow(counted, pad=TrackRow.pad_id, drone=TrackRow.uav_id)
            else:
                minutes = TrackMinuteRow.minute_ms.between(query.from_ms - 60_000, query.until_ms)
                counted = select(func.coalesce(func.sum(TrackMinuteRow.positions), 0)).where(minutes)
            positions = await database.scalar(counted)
            decided = select(func.count()).select_from(VerdictRow).where(*self._verdict_conditions())
            verdicts = await database.scalar(
                self._scope.narrow(decided, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
            )
        return int(positions or 0) + int(verdicts or 0)

    async def drones(self) -> AsyncIterator[str]:
        """Drones that may have been heard in the window, by serial number."""
        after = ""
        while True:
            query = select(LatestTrackRow.uav_id).where(
                LatestTrackRow.uav_id > after, LatestTrackRow.t_ms >= self._query.from_ms
            )
            if self._query.drone is not None:
                query = query.where(LatestTrackRow.uav_id == self._query.drone)
            async with self._database.read() as database:
                found = (await database.scalars(query.order_by(LatestTrackRow.uav_id).limit(PAGE))).all()
            for uav_id in found:
                yield uav_id
            if len(found) < PAGE:
                return
            after = found[-1]

    async def positions(self, uav_id: str) -> AsyncIterator[list[Record]]:
        """Pages of a drone's claimed positions, oldest first."""
        after: tuple[int, int] | None = None
        while True:
            query = select(TrackRow.t_ms, TrackRow.id, TrackRow.received_ms, TrackRow.body).where(
                *self._positions(uav_id)
            )
            query = self._scope.narrow(query, pad=TrackRow.pad_id, drone=TrackRow.uav_id)
            if after is not None:
                query = query.where(TrackRow.t_ms >= after[0], tuple_(TrackRow.t_ms, TrackRow.id) > after)
            async with self._database.read() as database:
                found = (await database.execute(query.order_by(TrackRow.t_ms, TrackRow.id).limit(PAGE))).all()
            page = self._within(found, TRACK_FIELDS)
            if page:
                yield page
            if len(found) < PAGE:
                return
            after = (found[-1].t_ms, found[-1].id)

    async def estimates(self) -> AsyncIterator[list[Record]]:
        """Pages of pads' running estimates, a page for each session."""
        query = self._query
        async for session_ids in self._sessions():
            for session_id in session_ids:
                wanted = (
                    select(EstimateRow.t_ms, EstimateRow.id, EstimateRow.received_ms, EstimateRow.body)
                    .where(
                        EstimateRow.session_id == session_id, EstimateRow.t_ms.between(query.from_ms, query.until_ms)
                    )
                    .order_by(EstimateRow.t_ms, EstimateRow.id)
                    .limit(PAGE)
                )
                async with self._database.read() as database:
                    found = (await database.execute(wanted)).all()
                page = self._within(found, ESTIMATE_FIELDS)
                if page:
                    yield page

    async def verdicts(self) -> AsyncIterator[list[Record]]:
        """Pages of verdicts, oldest first: the ledger's record with the transaction that it stands in."""
        after: tuple[int, int] | None = None
        while True:
            query = select(VerdictRow).where(*self._verdict_conditions())
            query = self._scope.narrow(query, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
            place = tuple_(VerdictRow.block, VerdictRow.tx_index)
            if after is not None:
                query = query.where(place > after)
            async with self._database.read() as database:
                found = (
                    await database.scalars(query.order_by(VerdictRow.block, VerdictRow.tx_index).limit(PAGE))
                ).all()
            page = [verdict_of(row) for row in found]
            area = self._query.area
            if area is not None:
                page = [each for each in page if "lat_e7" in each and area.holds(each["lat_e7"], each["lon_e7"])]
            if page:
                yield page
            if len(found) < PAGE:
                return
            after = (found[-1].block, found[-1].tx_index)

    def _positions(self, uav_id: str) -> list[Any]:
        query = self._query
        conditions = [
            TrackRow.uav_id == uav_id,
            TrackRow.t_ms.between(query.from_ms, query.until_ms),
            TrackRow.received_ms >= query.from_ms - MAX_AHEAD_MS,
        ]
        return conditions if query.pad is None else [*conditions, TrackRow.pad_id == query.pad]

    def _verdict_conditions(self) -> list[Any]:
        query = self._query
        conditions: list[Any] = [VerdictRow.decided_ms.between(query.from_ms, query.until_ms)]
        if query.drone is not None:
            conditions.append(VerdictRow.uav_id == query.drone)
        return conditions if query.pad is None else [*conditions, VerdictRow.pad_id == query.pad]

    async def _sessions(self) -> AsyncIterator[list[str]]:
        after: tuple[int, str] | None = None
        while True:
            query = select(SessionRow.requested_ms, SessionRow.session_id).where(
                SessionRow.requested_ms.between(self._query.from_ms - CLOCKS_MS, self._query.until_ms)
            )
            query = self._scope.narrow(query, pad=SessionRow.pad_id, drone=SessionRow.uav_id)
            if self._query.drone is not None:
                query = query.where(SessionRow.uav_id == self._query.drone)
            if self._query.pad is not None:
                query = query.where(SessionRow.pad_id == self._query.pad)
            if after is not None:
                query = query.where(tuple_(SessionRow.requested_ms, SessionRow.session_id) > after)
            query = query.order_by(SessionRow.requested_ms, SessionRow.session_id).limit(PAGE)
            async with self._database.read() as database:
                found = (await database.execute(query)).all()
            yield [row.session_id for row in found]
            if len(found) < PAGE:
                return
            after = (found[-1].requested_ms, found[-1].session_id)

    def _within(self, rows: Any, names: tuple[str, ...]) -> list[Record]:
        """The rows' bodies, as far as they lie in the area: these fields, and when they were received."""
        page: list[Record] = []
        for row in rows:
            body = orjson.loads(row.body)
            if self._query.area is None or self._query.area.holds(body["lat_e7"], body["lon_e7"]):
                record = {name: body[name] for name in names if name in body}
                page.append(record | {"received_ms": row.received_ms})
        return page


def verdict_of(row: VerdictRow) -> Record:
    """A verdict, flat: where the drone was measured, else where it claimed to be."""
    record = orjson.loads(row.record)
    signed = record.get("signed") or {}
    broadcast, height = record.get("broadcast") or {}, record.get("height") or {}
    place = record.get("estimate") or signed.get("claim") or {}
    flat = {
        "uav_id": row.uav_id,
        "t_ms": row.decided_ms,
        "pad_id": row.pad_id,
        "session_id": row.session_id,
        "action": row.action,
        "outcome": row.outcome,
        "permission": row.permission,
        "rounds": row.rounds,
        "assurance": record.get("assurance"),
        "authorised": record.get("authorised"),
        "lat_e7": place.get("lat_e7"),
        "lon_e7": place.get("lon_e7"),
        "estimate_ms": record.get("estimate_ms"),
        "place": "estimate" if record.get("estimate") else "claim" if place else None,
        "claim_lat_e7": signed.get("claim", {}).get("lat_e7"),
        "claim_lon_e7": signed.get("claim", {}).get("lon_e7"),
        "signed_outcome": signed.get("outcome"),
        "signed_error_mm": signed.get("error_mm"),
        "signed_likelihood_ppm": signed.get("likelihood_ppm"),
        "height_outcome": height.get("outcome"),
        "height_claimed_mm": height.get("claimed_mm"),
        "height_measured_mm": height.get("measured_mm"),
        "broadcast_outcome": broadcast.get("outcome"),
        "broadcast_error_mm": broadcast.get("error_mm"),
        "buffer_mm": record.get("buffer_mm"),
        "reasons": " ".join(each["code"] for each in record.get("reasons", ())),
        "evidence_sha256": record.get("evidence_sha256"),
        "tx_id": row.tx_id,
        "block": row.block,
        "tx_index": row.tx_index,
    }
    return {name: value for name, value in flat.items() if value is not None}


VERDICT_FIELDS: Final = (
    "uav_id", "t_ms", "pad_id", "session_id", "action", "outcome", "permission", "rounds", "assurance", "authorised",
    "lat_e7", "lon_e7", "estimate_ms", "place", "claim_lat_e7", "claim_lon_e7", "signed_outcome", "signed_error_mm",
    "signed_likelihood_ppm", "height_outcome", "height_claimed_mm", "height_measured_mm", "broadcast_outcome",
    "broadcast_error_mm", "buffer_mm", "reasons", "evidence_sha256", "tx_id", "block", "tx_index",
)  # fmt: skip
