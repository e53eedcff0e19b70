"""The bus that the settings name. Zenoh is imported where it is used: not every backend has it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

from sqlalchemy.exc import SQLAlchemyError

from wonderland_backend.audit.queries import bus_key
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import head, revision
from wonderland_backend.errors import SettingsError
from wonderland_backend.http.times import now_ms
from wonderland_backend.settings.bus import BusSettings

if TYPE_CHECKING:
    from wonderland_backend.replicas.bus import Bus


@contextlib.asynccontextmanager
async def opened_bus(settings: BusSettings | None) -> AsyncIterator[Bus | None]:
    """The bus between backends; None without settings. Raises `SettingsError`."""
    if settings is None:
        yield None
        return
    try:
        from wonderland_backend.replicas.bus import Bus  # noqa: PLC0415
        from wonderland_bus.errors import BusError  # noqa: PLC0415
        from wonderland_bus.session import open_member  # noqa: PLC0415
        from wonderland_bus.settings import Member, Tls  # noqa: PLC0415
    except ImportError:
        raise SettingsError("bus: Zenoh is not installed; pip install 'wonderland-backend[zenoh]'") from None
    tls = Tls(ca=settings.ca, certificate=settings.certificate, key=settings.key)
    try:
        session = await asyncio.to_thread(open_member, Member(routers=settings.routers, tls=tls))
    except BusError as cause:
        raise SettingsError(f"bus: {cause}") from cause
    bus = Bus(session, now_ms)
    try:
        yield bus
    finally:
        await bus.close()


async def can_follow(url: str) -> bool:
    """Whether the database has this version's tables, and another backend with a bus was on duty; else it can wait."""
    database = Database(url)
    try:
        if await revision(database) != head():
            return False
        async with database.read() as session:
            return await bus_key(session) is not None
    except SQLAlchemyError:
        return False
    finally:
        await database.close()
