"""Where blocks come from: an interface, and the Fabric Gateway behind it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from typing import Annotated, Final, Protocol, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland_fabric_gateway.blocks import Block
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Network

SILENT_S: Final = 30.0
"""Without a block from a peer that says that it has more."""


class BlockSource(Protocol):
    """A ledger's blocks. Every failure to reach it is a `LedgerError`; a block that is none a `BlockError`."""

    def blocks(self, start: int) -> AsyncGenerator[Block, None]:
        """Blocks from number `start` on, without an end; parsed, their data hash checked."""
        ...

    async def height(self) -> int:
        """Number of blocks on the ledger."""
        ...


async def source_of(connection: HTTPConnection) -> BlockSource | None:
    """A dependency: where this backend reads blocks, for what the mirror does not keep."""
    return cast("BlockSource | None", connection.app.state.parts.get(BlockSource))


BlockSourceDep = Annotated[BlockSource | None, Depends(source_of)]


class GatewaySource:
    """The blocks of a channel, from the Deliver service behind a Gateway."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self._height = 0

    async def blocks(self, start: int) -> AsyncGenerator[Block, None]:
        """Blocks from number `start` on, without an end. Raises `LedgerError` where the peer owes one and is silent."""
        following = start
        async with await self.network.blocks(start_block=start) as stream:
            while True:
                try:
                    async with asyncio.timeout(SILENT_S if following < self._height else None):
                        block = await anext(stream)
                except StopAsyncIteration:
                    return
                except TimeoutError as error:
                    raise LedgerError(
                        f"the peer says that there are {self._height} blocks, and has sent none for {SILENT_S:.0f} s"
                    ) from error
                following = block.number + 1
                yield block

    async def height(self) -> int:
        """Number of blocks on the channel."""
        self._height = await self.network.height()
        return self._height
