"""Import of a file of zones: read in a thread, then all of it takes the last one's place, or nothing does."""

from __future__ import annotations

import asyncio
from dataclasses import asdict, replace
from typing import Any, Final

import orjson
from fastapi import Request
from sqlalchemy.exc import IntegrityError

from wonderland.problems import said
from wonderland_backend import audit
from wonderland_backend.context import Context
from wonderland_backend.errors import BadRequest, Conflict, TooManyRequests, Unprocessable
from wonderland_backend.person import Person
from wonderland_backend.zones import store
from wonderland_backend.zones.files.findings import Finding
from wonderland_backend.zones.files.reading import ZoneFile, read, zone_id_of

MAX_NAMED: Final = 20
UPLOAD_S: Final = 120
_SOON: Final = {"Retry-After": "5"}
_one_at_a_time: Final = asyncio.Lock()
"""A large file takes memory and some seconds of a processor; nobody waits for it, so that they cannot pile up."""


async def _body(request: Request) -> bytes:
    """The file; its size was bounded before (`Boundary`)."""
    try:
        async with asyncio.timeout(UPLOAD_S):
            return await request.body()
    except TimeoutError:
        raise BadRequest(said("upload_slow", limit_s=UPLOAD_S)) from None


async def import_file(context: Context, person: Person, request: Request, source: str, *, dry_run: bool) -> Any:
    """What the file says, as an ImportReport; it is imported where it has no error, and this is no dry run.

    With `new` besides, where it was to be imported: False where the same file is in force already. Raises `Problem`.
    """
    if _one_at_a_time.locked():
        raise TooManyRequests(said("zones_busy"), headers=_SOON)
    async with _one_at_a_time:
        return await _import(context, person, await _body(request), source, dry_run=dry_run)


async def import_data(context: Context, by: str, data: bytes, source: str) -> Any:
    """The same for a file that is at hand. Raises `Problem`."""
    async with _one_at_a_time:
        return await _import(context, by, data, source, dry_run=False)


async def end(context: Context, by: Person | str, source: str) -> None:
    """A source's data set holds no longer."""
    now_ms = context.clock()
    async with context.database.write() as connection:
        await store.end(connection, source, now_ms)
        await audit.record(connection, by, "end_zones", f"zones/{source}", t_ms=now_ms)


async def _import(context: Context, by: Person | str, data: bytes, source: str, *, dry_run: bool) -> Any:
    file = await asyncio.to_thread(read, data)
    import_id = context.randomness(16).hex()
    rows = await asyncio.to_thread(store.rows_of, file, import_id)
    async with context.database.read() as database:
        before = await store.current(database, source)
        held = await store.features_of(database, before.import_id) if before is not None else {}
        file = _not_twice(file, await store.elsewhere(database, source, [row["zone_id"] for row in rows]))
    report = {**_report(file), **_differences({row["zone_id"]: row["feature"] for row in rows}, held)}
    if dry_run:
        return report
    if file.error_count:
        raise Unprocessable(
            said("zones_errors", count=file.error_count),
            *((f"line {each.line}: {each.path}", each.message) for each in file.errors[:MAX_NAMED]),
        )
    if before is not None and before.file_sha256 == file.sha256:
        return {**report, "import_id": before.import_id, "new": False}
    now_ms = context.clock()
    data_set = store.set_row(file, import_id, source, by if isinstance(by, str) else by.name, now_ms)
    detail = {"import_id": import_id, "sha256": file.sha256, "zones": len(rows)}
    try:
        async with context.database.write() as connection:
            await store.replace(connection, data_set, rows)
            await audit.record(connection, by, "import_zones", f"zones/{source}", detail, t_ms=now_ms)
    except IntegrityError:
        raise Conflict(said("zones_changed")) from None
    return {**report, "import_id": import_id, "new": True}


def _not_twice(file: ZoneFile, taken: dict[str, str]) -> ZoneFile:
    """An error for each zone that another source has: then it would not be clear which of the two holds."""
    if not taken:
        return file
    errors = [
        Finding(1, 1, f"features[{index}]", f"zone {zone_id} is in the data set of {taken[zone_id]!r} already")
        for index, zone_id in enumerate(map(zone_id_of, file.features))
        if zone_id in taken
    ]
    return replace(file, errors=errors[:200], error_count=len(errors))


def _report(file: ZoneFile) -> dict[str, Any]:
    report: dict[str, Any] = {
        "sha256": file.sha256,
        "size_bytes": file.size_bytes,
        "zones": len(file.features),
        "valid": file.error_count == 0,
        "errors": [asdict(each) for each in file.errors],
        "error_count": file.error_count,
        "notices": [asdict(each) for each in file.notices],
        "notice_count": file.notice_count,
    }
    return report if file.format is None else {"format": file.format, **report}


def _differences(new: dict[str, str], held: dict[str, str]) -> dict[str, int]:
    both = new.keys() & held.keys()
    return {
        "added": len(new.keys() - held.keys()),
        "removed": len(held.keys() - new.keys()),
        "changed": sum(orjson.loads(new[each]) != orjson.loads(held[each]) for each in both),
    }
