"""A cable between a browser and a server: it can be pulled, which closes nothing, or cut, which closes all."""

from __future__ import annotations

import asyncio
import contextlib


class Cable:
    """Forwards TCP to a port of this machine, on the loop that opened it."""

    def __init__(self, target):
        self.port = 0
        self.is_pulled = False
        self._target = target
        self._ends, self._joins = set(), set()

    async def open(self, **where):
        self._server = await asyncio.start_server(self._join, **(where or {"host": "127.0.0.1", "port": 0}))
        self.port = self._server.sockets[0].getsockname()[1]

    async def close(self):
        self._server.close()
        await self.cut()
        await asyncio.gather(*self._joins, return_exceptions=True)

    async def cut(self):
        """End all connections at once."""
        for end in self._ends:
            end.transport.abort()

    async def _join(self, reader, writer):
        self._joins.add(asyncio.current_task())
        there, here = await asyncio.open_connection("127.0.0.1", self._target)
        ends = {writer, here}
        self._ends |= ends
        try:
            await asyncio.gather(self._carry(reader, here), self._carry(there, writer))
        finally:
            self._ends -= ends

    async def _carry(self, reader, writer):
        with contextlib.suppress(OSError):
            while data := await reader.read(65_536):
                if not self.is_pulled:
                    writer.write(data)
                    await writer.drain()
            writer.close()
