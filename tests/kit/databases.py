"""Migrated databases: each is a copy of one that was migrated once."""

from __future__ import annotations

import asyncio
import functools
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate


def make_tables(url):
    async def make():
        opened = Database(url)
        await migrate(opened)
        await opened.close()

    asyncio.run(make())


@pytest.fixture
def database_url(request, tmp_path):
    """SQLite, unless a test asks for both kinds by ``parametrize(..., indirect=True)``."""
    if getattr(request, "param", "sqlite") == "sqlite":
        yield f"sqlite:///{tmp_path / 'test.db'}"
        return
    postgres = request.getfixturevalue("postgres")
    url = postgres.new_database(migrated="database" in request.fixturenames)
    yield url
    postgres.drop(url)


@functools.cache
def _template():
    """A migrated SQLite database as bytes: migrating takes longer than most tests."""
    with tempfile.TemporaryDirectory(prefix="wonderland-template-") as directory:
        path = Path(directory) / "template.db"
        # In a thread of its own: this one may have a running event loop.
        with ThreadPoolExecutor(1) as thread:
            thread.submit(make_tables, f"sqlite:///{path}").result()
        return path.read_bytes()


def copy_migrated(path):
    """Put a migrated SQLite database there, unless there is one; its path."""
    path = Path(path)
    if not path.exists():
        path.write_bytes(_template())
    return path


@pytest.fixture
async def database(database_url):
    opened = Database(database_url)
    if opened.is_sqlite:
        copy_migrated(opened.url.database)
    yield opened
    await opened.close()
