"""The way in: Gateway → Network (a channel) → Contract (a chaincode)."""

from __future__ import annotations

import asyncio
import functools
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.gateway.backoff import Backoff
from wonderland_fabric_gateway.gateway.calls import Calls, Deadlines, Environment, system_now_ns
from wonderland_fabric_gateway.gateway.commit import Commit, CommitStatus, new_commit
from wonderland_fabric_gateway.gateway.deliver import (
    BlockSource,
    FilteredBlock,
    FilteredBlockSource,
    height,
    is_level,
)
from wonderland_fabric_gateway.gateway.errors import CommitError, EndorseError
from wonderland_fabric_gateway.gateway.events import Event, EventSource, Position
from wonderland_fabric_gateway.gateway.proposal import Proposal, new_proposal
from wonderland_fabric_gateway.gateway.settle import settle
from wonderland_fabric_gateway.gateway.streams import Stream
from wonderland_fabric_gateway.gateway.transaction import Transaction
from wonderland_fabric_gateway.gateways import Gateways
from wonderland_fabric_gateway.transactions import ValidationCode

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import grpc

    from wonderland_fabric_gateway.blocks import Block
    from wonderland_fabric_gateway.checkpoints import Checkpointer
    from wonderland_fabric_gateway.identity import Identity
    from wonderland_fabric_gateway.signing import Signer


@dataclass(frozen=True, slots=True)
class Submitted:
    """A transaction that is committed and valid. `payload` is what the contract answered."""

    tx_id: str
    block_number: int
    payload: bytes


class Gateway:
    """A client of a Fabric Gateway, acting as one identity.

    The caller opens and closes `channel` (`Connection.open_channel`, or any gRPC channel); many gateways
    (identities) may share one. Without `signer` everything is signed offline. `tls_certificate_sha256` is needed
    where peers demand client certificates and `channel` does not know it.
    """

    def __init__(
        self,
        channel: Gateways | grpc.aio.Channel,
        identity: Identity,
        signer: Signer | None,
        *,
        deadlines: Deadlines | None = None,
        now_ns: Callable[[], int] = system_now_ns,
        random_bytes: Callable[[int], bytes] = os.urandom,
        tls_certificate_sha256: bytes = b"",
    ) -> None:
        self.identity: Final = identity
        gateways = Gateways.of(channel)
        self._environment = Environment(
            calls=Calls(gateways, deadlines or Deadlines()),
            identity=identity,
            signer=signer,
            now_ns=now_ns,
            random_bytes=random_bytes,
            tls_certificate_sha256=tls_certificate_sha256 or gateways.tls_certificate_sha256,
        )

    def network(self, channel_name: str) -> Network:
        """A channel of the ledger."""
        return Network(self._environment, channel_name)

    def new_proposal(self, data: bytes) -> Proposal:
        """A proposal from `Proposal.to_bytes`. Raises `MalformedError`."""
        return Proposal.from_bytes(self._environment, data)

    def new_signed_proposal(self, data: bytes, signature: bytes) -> Proposal:
        """A proposal from its bytes, with a signature made elsewhere. Raises `MalformedError`."""
        return self.new_proposal(data).signed(signature)

    def new_transaction(self, data: bytes) -> Transaction:
        """A transaction from `Transaction.to_bytes`. Raises `MalformedError`."""
        return Transaction.from_bytes(self._environment, data)

    def new_signed_transaction(self, data: bytes, signature: bytes) -> Transaction:
        """A transaction from its bytes, with a signature made elsewhere. Raises `MalformedError`."""
        return self.new_transaction(data).signed(signature)

    def new_commit(self, data: bytes) -> Commit:
        """A commit request from `Commit.to_bytes`. Raises `MalformedError`."""
        return Commit.from_bytes(self._environment, data)

    def new_signed_commit(self, data: bytes, signature: bytes) -> Commit:
        """A commit request from its bytes, with a signature made elsewhere. Raises `MalformedError`."""
        return self.new_commit(data).signed(signature)


class Network:
    """A channel: its contracts, its blocks, its events."""

    def __init__(self, environment: Environment, name: str) -> None:
        self.name: Final = name
        self._environment = environment
        environment.calls.compare_by(functools.partial(is_level, environment, name))

    def contract(self, chaincode: str) -> Contract:
        """A contract on this channel."""
        return Contract(self._environment, self.name, chaincode)

    def commit(self, tx_id: str) -> Commit:
        """The question what became of any transaction, for example one of before a restart."""
        return new_commit(self._environment, self.name, tx_id)

    async def settle(self, transaction: Transaction) -> CommitStatus:
        """Submit a transaction that was signed elsewhere, by anybody, until it has an outcome, which this asks for.

        The same bytes may be handed over several times; they take effect once at most. Raises `SubmitError`,
        `CommitStatusError`, `CommitUnknownError`.
        """
        return await settle(transaction, self._environment)

    async def height(self) -> int:
        """How many blocks the channel has. Raises `StreamError`."""
        return await height(self._environment, self.name)

    def chaincode_events(
        self,
        chaincode: str,
        *,
        start_block: int | None = None,
        after_transaction_id: str = "",
        checkpointer: Checkpointer | None = None,
        reconnect: bool = False,
    ) -> Stream[Event]:
        """A contract's events: from now on, from a block on, after a transaction, or where a checkpoint says.

        A checkpoint that was saved overrides the other two. Save ``event.checkpoint`` when an event has been dealt
        with. Raises `CheckpointError` here; when opened, `UnknownTransactionError` for a place that is not on this
        chain.
        """
        saved = checkpointer.load() if checkpointer else None
        position: Position | None = None
        if saved is not None:
            position = Position(saved.block_number, saved.tx_id, exact=True)
        elif start_block is not None or after_transaction_id:
            position = Position(start_block, after_transaction_id)
        source = EventSource(self.name, chaincode, position)
        return Stream(self._environment, source, self.name, reconnect=reconnect)

    def blocks(
        self, *, start_block: int | None = None, checkpointer: Checkpointer | None = None, reconnect: bool = False
    ) -> Stream[Block]:
        """Whole blocks: from now on, from a block on, or from where a checkpoint says.

        Save ``Checkpoint.after_block(block.number)``. Raises `CheckpointError` here; when opened,
        `UnknownTransactionError` for a checkpoint beyond the chain.
        """
        start, saved = _start(start_block, checkpointer)
        source = BlockSource(self.name, start, must_be_reached=saved)
        return Stream(self._environment, source, self.name, reconnect=reconnect)

    def filtered_blocks(
        self, *, start_block: int | None = None, checkpointer: Checkpointer | None = None, reconnect: bool = False
    ) -> Stream[FilteredBlock]:
        """Outlines of blocks, as `blocks`."""
        start, saved = _start(start_block, checkpointer)
        source = FilteredBlockSource(self.name, start, must_be_reached=saved)
        return Stream(self._environment, source, self.name, reconnect=reconnect)


class Contract:
    """A contract on a channel."""

    def __init__(self, environment: Environment, channel: str, chaincode: str) -> None:
        self.channel: Final = channel
        self.chaincode: Final = chaincode
        self._environment = environment

    def propose(
        self,
        function: str,
        *arguments: str | bytes,
        transient: Mapping[str, bytes] | None = None,
        endorsing_organizations: Sequence[str] = (),
    ) -> Proposal:
        """A proposal to be signed, evaluated or endorsed stage by stage. Text arguments are sent as UTF-8.

        `transient` data reaches the contract and is not recorded. `endorsing_organizations` are MSP ids; none given
        means that the gateway finds out by the endorsement policy.
        """
        encoded = [each.encode() if isinstance(each, str) else each for each in (function, *arguments)]
        return new_proposal(
            self._environment,
            self.channel,
            self.chaincode,
            encoded,
            transient=transient or {},
            organizations=endorsing_organizations,
        )

    async def evaluate(
        self,
        function: str,
        *arguments: str | bytes,
        transient: Mapping[str, bytes] | None = None,
        endorsing_organizations: Sequence[str] = (),
    ) -> bytes:
        """Query: run a function on one peer and record nothing. Raises `EvaluateError`."""
        proposal = self.propose(
            function, *arguments, transient=transient, endorsing_organizations=endorsing_organizations
        )
        return await proposal.evaluate()

    async def submit(
        self,
        function: str,
        *arguments: str | bytes,
        transient: Mapping[str, bytes] | None = None,
        endorsing_organizations: Sequence[str] = (),
    ) -> Submitted:
        """Endorse, submit, and wait until the transaction is committed and valid.

        When an answer is lost or no outcome comes, the same transaction is submitted again: it takes effect once at
        most. Raises `EndorseError`, `SubmitError`, `CommitStatusError`, `CommitError`, `CommitUnknownError`, each
        with `tx_id`.
        """
        proposal = self.propose(
            function, *arguments, transient=transient, endorsing_organizations=endorsing_organizations
        )
        transaction = await proposal.endorse()
        status = await settle(transaction, self._environment)
        status.require_valid()
        return Submitted(transaction.tx_id, status.block_number, transaction.payload)

    async def leave_if_behind(self) -> None:
        """Go to another peer of the organisation, if the one that is asked is behind: after an answer that says so."""
        await self._environment.calls.leave_if_behind()

    async def submit_with_retry(
        self,
        function: str,
        *arguments: str | bytes,
        transient: Mapping[str, bytes] | None = None,
        endorsing_organizations: Sequence[str] = (),
        attempts: int = 5,
    ) -> Submitted:
        """As `submit`, with new attempts where one is safe and may help, after a random pause.

        That is: the transaction is known to be invalid because another one came between (MVCC, phantom), or the
        peers disagreed because they stood at different blocks (`attempts` in all); or the peers do not know enough of
        each other yet to endorse (for `Deadlines.gossip_s`). An endorsement that was not enough is tried once more:
        another transaction of the same block may have made the key, and with it who must endorse. Nothing else is
        tried again.
        """
        attempt = _Attempts(attempts)
        backoff = Backoff(self._environment.random_bytes, first_s=0.02, max_s=1.0)
        loop = asyncio.get_running_loop()
        gossip_until_s = loop.time() + self._environment.calls.deadlines.gossip_s
        while True:
            try:
                return await self.submit(
                    function, *arguments, transient=transient, endorsing_organizations=endorsing_organizations
                )
            except CommitError as error:
                if not attempt.again_after_invalid(error):
                    raise
            except EndorseError as error:
                if not attempt.again_after_refusal(error, is_gossip_time=loop.time() < gossip_until_s):
                    raise
                if error.is_mismatch:
                    await self.leave_if_behind()
            await asyncio.sleep(backoff.next_s())


class _Attempts:
    """What was tried so far, and whether one more attempt is safe and may help."""

    def __init__(self, left: int) -> None:
        self._left = left
        self._unendorsed = False

    def again_after_invalid(self, error: CommitError) -> bool:
        lacking = error.code == ValidationCode.ENDORSEMENT_POLICY_FAILURE
        if not error.is_conflict and (self._unendorsed or not lacking):
            return False
        self._unendorsed = self._unendorsed or lacking
        return self._one_less()

    def again_after_refusal(self, error: EndorseError, *, is_gossip_time: bool) -> bool:
        if error.is_mismatch:
            return self._one_less()
        return error.has_no_endorsers and is_gossip_time

    def _one_less(self) -> bool:
        self._left -= 1
        return self._left > 0


def _start(start_block: int | None, checkpointer: Checkpointer | None) -> tuple[int | None, bool]:
    """The block to begin with, and whether a checkpoint says so."""
    saved = checkpointer.load() if checkpointer else None
    return (start_block, False) if saved is None else (saved.block_number, True)
