"""Where blocks come from: an interface, and the Fabric Gateway behind it."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from typing import Annotated, Protocol, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland_fabric_gateway.blocks import Block
from wonderland_fabric_gateway.gateway import Network


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

    async def blocks(self, start: int) -> AsyncGenerator[Block, None]:
        """Blocks from number `start` on, without an end."""
        async with await self.network.blocks(start_block=start) as stream:
            async for block in stream:
                yield block

    async def height(self) -> int:
        """Number of blocks on the channel."""
        return await self.network.height()
