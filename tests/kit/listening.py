"""The listener of listener.py as a process, and what it has written."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from pathlib import Path

from kit.listener import open_database

SCRIPT = Path(__file__).with_name("listener.py")


class Listener:
    """Start it, kill it, start it again; its rows stay."""

    def __init__(self, connection_file, identity, database):
        self._arguments = (str(connection_file), identity, str(database))
        self._database = database
        self._process = None

    async def start(self):
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, str(SCRIPT), *self._arguments, stdout=asyncio.subprocess.PIPE
        )
        async with asyncio.timeout(60):
            assert await self._process.stdout.readline() == b"listening\n"

    async def kill(self):
        """kill −9."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGKILL)
        await self._process.wait()
        self._process._transport.close()

    def rows(self):
        """Block, transaction and name of each event, in the order in which they came."""
        database = open_database(self._database)
        try:
            return database.execute("SELECT block, tx_id, name FROM events ORDER BY rowid").fetchall()
        finally:
            database.close()

    async def reach(self, tx_id):
        """Until that transaction's event is there."""
        async with asyncio.timeout(60):
            while not any(row[1] == tx_id for row in self.rows()[-20:]):
                assert self._process.returncode is None, "the listener ended"
                await asyncio.sleep(0.05)
