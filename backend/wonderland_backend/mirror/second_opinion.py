"""Which transactions of a block are valid: nobody signs that in the block, so another organisation's peer is asked.

It signs its answer, which goes through the same Gateway: that one can hold it back, and cannot change it. Where nobody
else can be asked the mirror goes on, and says since when it believes one organisation alone.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Final, Protocol

from fabric_protos.common import common_pb2

from wonderland_backend.mirror.status import MirrorStatus
from wonderland_fabric_gateway.blocks import Block, parse_block
from wonderland_fabric_gateway.errors import LedgerError, VerificationError
from wonderland_fabric_gateway.gateway import GatewayError, Network
from wonderland_fabric_gateway.transactions import Invocation
from wonderland_fabric_gateway.verification.channel_trust import ChannelTrust
from wonderland_fabric_gateway.verification.light_client import Endorsers
from wonderland_fabric_gateway.verification.transaction_checks import endorsers

_log = logging.getLogger(__name__)

PATIENCE_S: Final = 3.0
"""Another organisation's peer commits a block at about the same time; longer, and it counts as away."""
AGAIN_S: Final = 0.05
AWAY_S: Final = 30.0
"""One that was away is asked again after so long; blocks meanwhile do not wait for it."""
CODES: Final = common_pb2.TRANSACTIONS_FILTER


class Asked(Protocol):
    """Somebody who can be asked for a block as an organisation's peer has it, with that peer's signature."""

    async def block(self, number: int, msp_id: str) -> Invocation:
        """Its signed answer. Raises `LedgerError`."""
        ...


class GatewayAsked:
    """Peers of the channel, behind a Gateway."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._queries = network.contract("qscc")

    async def block(self, number: int, msp_id: str) -> Invocation:
        """What a peer of that organisation signs of a block."""
        proposal = self._queries.propose(
            "GetBlockByNumber", self._network.name, str(number), endorsing_organizations=[msp_id]
        )
        return (await proposal.endorse()).invocation


class SecondOpinion:
    """`own`: the organisation whose peers pass the blocks on. `status` shows since when nobody else can be asked."""

    def __init__(self, asked: Asked, own: str, *, clock: Callable[[], int], patience_s: float = PATIENCE_S) -> None:
        self._asked = asked
        self._own = own
        self._clock = clock
        self._patience_s = patience_s
        self._others: set[str] = set()
        self._answered = ""
        self._ask_again_s = 0.0
        self.status = MirrorStatus()

    async def require(self, trust: ChannelTrust, block: Block, endorsed: Endorsers) -> None:
        """Another organisation has the same block, with the same validity. Raises `VerificationError` if not.

        Those are asked whose peers endorse, by signatures that hold; the one that answered last is asked first.
        """
        self._others |= {each.msp_id for signers in endorsed for each in signers or ()} - {self._own}
        others = sorted(self._others & set(trust.config.organisations), key=lambda each: (each != self._answered, each))
        if not others or not any(each.invocation is not None for each in block.transactions):
            return
        if self.status.alone_since_ms is not None and time.monotonic() < self._ask_again_s:
            return
        for msp_id in others:
            theirs = await self._answer(trust, block.number, msp_id)
            if theirs is None:
                continue
            self.status.alone_since_ms, self._answered = None, msp_id
            if theirs.header != block.header:
                raise VerificationError(f"it is another one at {msp_id}")
            for mine, its in zip(block.transactions, theirs.transactions, strict=True):
                if mine.validation_code != its.validation_code:
                    raise VerificationError(
                        f"transaction {mine.tx_id[:16]} is {mine.validation_name} here and "
                        f"{its.validation_name} at {msp_id}"
                    )
            return
        if self.status.alone_since_ms is None:
            self.status.alone_since_ms = self._clock()
            _log.warning("no peer of %s says what it has of block %s", " or ".join(others), block.number)
        self._ask_again_s = time.monotonic() + AWAY_S

    async def _answer(self, trust: ChannelTrust, number: int, msp_id: str) -> Block | None:
        """A block as that organisation's peer has it; None where none says so in time."""
        answer: Invocation | None = None
        problem: LedgerError | None = None
        try:
            async with asyncio.timeout(self._patience_s):
                while answer is None:
                    try:
                        answer = await self._asked.block(number, msp_id)
                    except GatewayError as error:  # it may not have the block yet
                        problem = error
                        await asyncio.sleep(AGAIN_S)
        except TimeoutError:
            pass
        if answer is None:
            _log.info("%s was asked for block %s in vain: %s", msp_id, number, problem or "no answer")
            return None
        signers = endorsers(trust, answer, self._clock())
        if {each.msp_id for each in signers} != {msp_id}:
            raise VerificationError(f"an answer about it that {msp_id} did not sign")
        return parse_block(answer.response.payload)
