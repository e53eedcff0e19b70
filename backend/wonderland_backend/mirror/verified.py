"""A ledger's blocks, each checked before anybody believes it: by the channel's own configuration, from block 0 on.

Many blocks are looked at in other processes, side by side; what follows from one block to the next is done here, in
their order. A block that does not hold halts the mirror: what it mirrored before stands.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import multiprocessing
import os
from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Final

from wonderland_backend.errors import MirrorHalted
from wonderland_backend.http.times import now_ms
from wonderland_backend.mirror.second_opinion import SecondOpinion
from wonderland_backend.mirror.source import BlockSource
from wonderland_fabric_gateway.blocks import Block, parse_block
from wonderland_fabric_gateway.errors import BlockError, LedgerError, VerificationError
from wonderland_fabric_gateway.verification.block_checks import last_config_of
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_gateway.verification.light_client import Endorsers, LightClient, require_ordered, signed

PoliciesAt = Callable[[], Awaitable[tuple[int | None, dict[bytes, bytes]]]]
MANY_BLOCKS: Final = 200
"""From so many on, other processes help."""
WAITING_BLOCKS: Final = 32
MOST_PROCESSES: Final = 4
MOST_CONFIGURATIONS: Final = 10_000


class VerifiedSource:
    """`policies` says after which block which endorsement policies hold, as far as the mirror has come.

    `pinned` is the hash of the channel's first block's header, where an operator has compared it with somebody else's.
    """

    def __init__(
        self,
        source: BlockSource,
        policies: PoliciesAt,
        *,
        pinned: bytes | None = None,
        opinion: SecondOpinion | None = None,
    ) -> None:
        self.plain: Final = source
        self._policies = policies
        self._pinned = pinned
        self.opinion = opinion

    async def height(self) -> int:
        """Number of blocks on the ledger, by the word of the peer that is asked."""
        return await self.plain.height()

    async def blocks(self, start: int) -> AsyncGenerator[Block, None]:
        """Blocks from number `start` on, without an end. Raises `MirrorHalted` for one that is not to be believed.

        The first one is not looked at where it is mirrored already: whoever asks for it compares it with what is there.
        """
        height = await self.plain.height()
        with contextlib.ExitStack() as stack:
            pool: ProcessPoolExecutor | None = None
            if height - start > MANY_BLOCKS:
                pool = stack.enter_context(_pool())
            async with contextlib.aclosing(self.plain.blocks(start)) as stream:
                try:
                    first = await anext(stream)
                    client = await self._client(first)
                    # Nobody signs a channel's first block; where more are said to follow, the second one stands for it.
                    held = first if first.number == 0 and height > 1 else None
                    if held is None:
                        yield first
                    async with contextlib.aclosing(self._checked(client, stream, pool, height)) as checked:
                        async for block in checked:
                            if held is not None:
                                block.require_follows(held.header)
                                yield held
                                held = None
                            yield block
                except VerificationError as error:
                    raise MirrorHalted(
                        f"The ledger's peer passed on what is not to be believed: {error}. What was mirrored before "
                        "stands. Compare with another organisation's peer before you start this backend again."
                    ) from error
                except BrokenProcessPool as error:
                    raise LedgerError("a process that checks blocks has ended") from error

    async def _checked(
        self, client: LightClient, stream: AsyncGenerator[Block, None], pool: ProcessPoolExecutor | None, height: int
    ) -> AsyncGenerator[Block, None]:
        """Blocks in their order, as soon as they are checked; those that came before the stream broke, too."""
        loop = asyncio.get_running_loop()
        waiting: deque[tuple[Block, asyncio.Task[Endorsers]]] = deque()

        async def looked_at(trust: ChannelTrust, block: Block, *, aside: bool) -> Endorsers:
            if pool is not None and aside:
                raw = block.to_bytes()
                found = await loop.run_in_executor(pool, _signed, trust.number, trust.envelope, raw, now_ms())
            else:
                found = signed(trust, block, now_ms())
            if self.opinion is not None:
                await self.opinion.require(trust, block, found)
            return found

        async def oldest() -> Block:
            block, found = waiting[0]
            try:
                endorsed = await found
            except VerificationError as error:
                raise VerificationError(f"block {block.number}: {error}") from error
            client.take(block, endorsed)
            waiting.popleft()
            return block

        broken: LedgerError | None = None
        following = _next_of(stream)
        try:
            while broken is None:
                if waiting:
                    await asyncio.wait({following, waiting[0][1]}, return_when=asyncio.FIRST_COMPLETED)
                    if waiting[0][1].done() or len(waiting) >= WAITING_BLOCKS:
                        yield await oldest()
                        continue
                try:
                    block = await following
                except LedgerError as error:
                    broken = error
                    break
                if block is None:
                    break
                following = _next_of(stream)
                is_alone = block.number >= height - 1 or block.config is not None
                while waiting and is_alone:  # it depends on the configuration before it, or it is the last for a while
                    yield await oldest()
                if pool is not None and block.number >= height - 1:  # from here on blocks come one at a time
                    pool.shutdown(wait=False)
                    pool = None
                waiting.append((block, loop.create_task(looked_at(client.trust, block, aside=not is_alone))))
                if is_alone:
                    yield await oldest()
            while waiting:
                yield await oldest()
            if broken is not None:
                raise broken
        finally:
            begun = (following, *(found for _, found in waiting))
            for each in begun:
                each.cancel()
            await asyncio.gather(*begun, return_exceptions=True)

    async def _client(self, first: Block) -> LightClient:
        """What holds after the first block of a stream."""
        if first.number == 0:
            return LightClient.begin(first, self._pinned)
        mirrored, policies = await self._policies()
        if mirrored != first.number:
            policies = {}  # nobody goes on from here; whoever asks looks at this block alone
        return LightClient(first.number, await self._trust(first), policies)

    async def _trust(self, block: Block) -> ChannelTrust:
        """What is in force after a block: from the first configuration on, each checked by the one before."""
        path: list[tuple[Block, Block]] = []
        at = block
        while at.number:
            number = last_config_of(at)
            if number > at.number or len(path) > MOST_CONFIGURATIONS:
                raise VerificationError(f"block {at.number} names config block {number}")
            config = at if number == at.number else await self._one(number)
            path.append((config, at))
            at = await self._one(number - 1) if number else config
        client = LightClient.begin(at, self._pinned)
        for config, named_by in reversed(path):
            if config.number:
                client.number = config.number - 1
                client.take(config, now_ms=now_ms())
            if named_by is not config:
                require_ordered(client.trust, named_by, now_ms())
        return client.trust

    async def _one(self, number: int) -> Block:
        async with contextlib.aclosing(self.plain.blocks(number)) as stream:
            block = await anext(stream)
        if block.number != number:
            raise BlockError(f"block {block.number} came where {number} was asked for")
        return block


def _next_of(stream: AsyncGenerator[Block, None]) -> asyncio.Task[Block | None]:
    """The stream's next block; None at its end."""

    async def following() -> Block | None:
        return await anext(stream, None)

    return asyncio.create_task(following())


def _pool() -> ProcessPoolExecutor:
    """Other processes, made anew: those of gRPC's threads cannot be copied."""
    count = min(max((os.cpu_count() or 1) - 1, 1), MOST_PROCESSES)
    return ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))


@functools.lru_cache(maxsize=8)
def _trusted(number: int, envelope: bytes) -> ChannelTrust:
    return ChannelTrust.of(number, envelope)


def _signed(number: int, envelope: bytes, block: bytes, at_ms: int) -> Endorsers:
    """In another process: the signatures of one block."""
    return signed(_trusted(number, envelope), parse_block(block), at_ms)
