"""A service manager as a service meets it: the socket of sd_notify(3)."""

from __future__ import annotations

import asyncio
import contextlib
import socket


@contextlib.contextmanager
def manager(directory):
    """The socket of a service manager, and the environment that it gives."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as told:
        path = str(directory / "notify")
        told.bind(path)
        told.setblocking(False)
        yield told, {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "200000"}


async def next_said(told):
    async with asyncio.timeout(30):
        return (await asyncio.get_running_loop().sock_recv(told, 4_096)).decode()
