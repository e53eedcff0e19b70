"""Whether a block has come to every peer: one that lags answers from before it, and refuses what rests on it."""

from __future__ import annotations

import asyncio
import contextlib

from wonderland_fabric_gateway.gateway import Gateway

PATIENCE_S = 60
"""On a machine that is busy with other tests."""


@contextlib.asynccontextmanager
async def every_peer(connections):
    """A wait until each of these connections' own peer has a block: ``await everywhere(block_number)``."""
    async with contextlib.AsyncExitStack() as stack:
        channels = []
        for connection in connections:
            channel = await stack.enter_async_context(connection.open_channel())
            name = next(iter(connection.identities))
            gateway = Gateway(channel, connection.identity(name), connection.signer(name))
            channels.append(gateway.network(connection.channel))

        async def everywhere(block_number):
            async with asyncio.timeout(PATIENCE_S):
                for channel in channels:
                    while await channel.height() <= block_number:
                        await asyncio.sleep(0.005)

        yield everywhere
