"""Exports from the wish to the last byte: prepared and audited, streamed, and what became of each."""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from typing import Any, Final

import anyio
import orjson

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.context import Context
from wonderland_backend.db.tables.exports import ExportRow
from wonderland_backend.errors import BadRequest, Conflict, NotFound, SwitchedOff, TooManyRequests
from wonderland_backend.exports import store
from wonderland_backend.exports.archive import archive
from wonderland_backend.exports.formats import FORMATS, Counts
from wonderland_backend.exports.queries import Rows
from wonderland_backend.exports.schemas import ExportQuery
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.person import Person
from wonderland_backend.replay.queries.moment import moment
from wonderland_backend.settings.outputs import Format

KEPT_MS: Final = 3_600_000
MAX_AT_ONCE: Final = 4
MAX_EACH: Final = 2
"""Of one person or machine, so that it leaves room for others."""
WAIT_S: Final = 10
STALLED_MS: Final = 120_000
"""An export of which nothing was heard for so long has ended with its server."""
PROGRESS_BYTES: Final = 1 << 20
FORGOTTEN_MS: Final = 90 * 86_400_000


class TooLarge(Exception):  # noqa: N818 - ends a stream whose beginning was sent already
    """More rows than an export may have."""


def require_on(context: Context, wanted: Format) -> None:
    """Raises `SwitchedOff` for a format that this server does not give out."""
    if wanted not in context.settings.outputs.exports:
        raise SwitchedOff(said("export_off", format=wanted))


async def prepare(context: Context, person: Person, query: ExportQuery) -> ExportRow:
    """Take a wish down. Raises `BadRequest` for a window that holds too much, `SwitchedOff`."""
    require_on(context, query.format)
    now = context.clock()
    expected = await Rows(context.database, person.scope, query).expected()
    most = context.settings.export_max_rows
    if expected > most:
        raise BadRequest(
            said("export_too_large", expected=expected, most=most),
            ("body.until_ms", said("export_too_large_field")),
        )
    wanted = query.model_dump(exclude_none=True)
    row: dict[str, Any] = {
        "export_id": context.randomness(16).hex(),
        "person_id": person.person_id,
        "created_ms": now,
        "query": orjson.dumps(wanted).decode(),
        "expected": expected,
        "state": "prepared",
        "rows": 0,
        "bytes": 0,
        "changed_ms": now,
        "sha256": None,
    }
    async with context.database.write() as connection:
        await store.add(connection, row, forget_before_ms=now - FORGOTTEN_MS)
        await audit.record(connection, person, "export", f"export/{row['export_id']}", wanted, t_ms=now)
    return ExportRow(**row)


async def find_export(context: Context, person: Person, export_id: str) -> ExportRow:
    """One's own export. Raises `NotFound`."""
    async with context.database.read() as database:
        row = await database.get(ExportRow, export_id)
    if row is None or row.person_id != person.person_id:
        raise NotFound(said("no_such_export"))
    return row


async def begin(context: Context, row: ExportRow) -> ExportQuery:
    """Claim it for one stream. Raises `NotFound`, `SwitchedOff`, `Conflict`, `TooManyRequests`."""
    now = context.clock()
    query = ExportQuery.model_validate_json(row.query)
    require_on(context, query.format)
    if row.created_ms + KEPT_MS < now:
        raise NotFound(said("export_expired"))
    async with context.database.write() as connection:
        of = await store.people_of_running(connection, now - STALLED_MS)
        if len(of) >= MAX_AT_ONCE or of.count(row.person_id) >= MAX_EACH:
            raise TooManyRequests(said("exports_busy"), headers={"Retry-After": str(WAIT_S)})
        claimed = await store.claim(connection, row.export_id, now)
    if not claimed:
        raise Conflict(said("export_fetched"))
    return query


async def stream(
    context: Context, mirror: MirrorStatus, person: Person, row: ExportRow, query: ExportQuery
) -> AsyncIterator[bytes]:
    """The archive in pieces; how far it came is kept as it goes."""
    counts = Counts()
    digest = hashlib.sha256()
    sent = noted = 0
    state = "broken"
    heights = await _heights(context, mirror, query)

    def manifest(files: list[dict[str, Any]]) -> dict[str, Any]:
        return {
            "what": "A window of what Wonderland knew: claimed positions and estimates are unverified, verdicts stand "
            "on the ledger.",
            "export_id": row.export_id,
            "made_ms": context.clock(),
            "software": f"wonderland {context.version}",
            "query": query.model_dump(exclude_none=True),
            "units": {"_e7": "degrees × 10⁷, WGS-84", "_mm": "millimetres", "_ms": "ms since the Unix epoch (UTC)",
                      "_cdeg": "degrees × 100", "_ppm": "parts per million"},
            "ledger": heights,
            "counts": {**counts.of, "left_out_same_moment": counts.same_moment},
            "files": files,
            "evidence": "The evidence of a verdict: /api/v1/sessions/{session_id}",
        }  # fmt: skip

    try:
        rows = Rows(context.database, person.scope, query)
        async for piece in archive(FORMATS[query.format](rows, counts), manifest, context.clock()):
            if counts.rows > 1.2 * context.settings.export_max_rows:
                raise TooLarge
            digest.update(piece)
            sent += len(piece)
            yield piece
            if sent - noted >= PROGRESS_BYTES:
                noted = sent
                await _note(context, row, "running", counts.rows, sent)
        state = "done"
    finally:
        # Also where the client has gone, and with it this task.
        with anyio.CancelScope(shield=True):
            await _note(context, row, state, counts.rows, sent, digest.hexdigest() if state == "done" else None)


async def _note(context: Context, row: ExportRow, state: str, rows: int, size: int, sha256: str | None = None) -> None:
    values = {"state": state, "rows": rows, "bytes": size, "changed_ms": context.clock(), "sha256": sha256}
    async with context.database.write() as connection:
        await store.change(connection, row.export_id, values)


async def _heights(context: Context, mirror: MirrorStatus, query: ExportQuery) -> dict[str, Any]:
    async with context.database.read() as database:
        first, last = await moment(database, query.from_ms), await moment(database, query.until_ms)
    return {
        "channel": mirror.channel,
        "block_at_from": first.block,
        "block_at_until": last.block,
        "block_when_made": mirror.mirrored - 1,
    }
