"""The way in: Gateway → Network (a channel) → Contract (a chaincode)."""

from __future__ import annotations

import asyncio
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import grpc

from wonderland.ledger.gateway.backoff import Backoff
from wonderland.ledger.gateway.calls import Calls, Deadlines, Environment, system_now_ns
from wonderland.ledger.gateway.commit import Commit, CommitStatus, new_commit
from wonderland.ledger.gateway.deliver import (
    BlockSource,
    FilteredBlock,
    FilteredBlockSource,
    height,
)
from wonderland.ledger.gateway.errors import (
    CommitError,
    CommitStatusError,
    CommitUnknownError,
    EndorseError,
    SubmitError,
)
from wonderland.ledger.gateway.events import Event, EventSource, Position
from wonderland.ledger.gateway.proposal import Proposal, new_proposal
from wonderland.ledger.gateway.streams import Stream
from wonderland.ledger.gateway.transaction import Transaction
from wonderland.ledger.transactions import ValidationCode

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from wonderland.ledger.blocks import Block
    from wonderland.ledger.checkpoints import Checkpointer
    from wonderland.ledger.identity import Identity
    from wonderland.ledger.signing import Signer

_WORTH_ASKING_AGAIN: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.INTERNAL,
        grpc.StatusCode.UNKNOWN,
        grpc.StatusCode.CANCELLED,
    }
)


@dataclass(frozen=True, slots=True)
class Submitted:
    """A transaction that is committed and valid. `payload` is what the contract answered."""

    tx_id: str
    block_number: int
    payload: bytes


class Gateway:
    """A client of a Fabric Gateway, acting as one identity.

    The caller opens and closes `channel`; many gateways (identities) may share one. Without `signer` everything
    is signed offline. `tls_certificate_sha256` is needed where peers demand client certificates.
    """

    def __init__(
        self,
        channel: grpc.aio.Channel,
        identity: Identity,
        signer: Signer | None,
        *,
        deadlines: Deadlines | None = None,
        now_ns: Callable[[], int] = system_now_ns,
        random_bytes: Callable[[int], bytes] = os.urandom,
        tls_certificate_sha256: bytes = b"",
    ) -> None:
        self.identity: Final = identity
        self._environment = Environment(
            calls=Calls(channel, deadlines or Deadlines()),
            identity=identity,
            signer=signer,
            now_ns=now_ns,
            random_bytes=random_bytes,
            tls_certificate_sha256=tls_certificate_sha256,
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

    def contract(self, chaincode: str) -> Contract:
        """A contract on this channel."""
        return Contract(self._environment, self.name, chaincode)

    def commit(self, tx_id: str) -> Commit:
        """The question what became of any transaction, for example one of before a restart."""
        return new_commit(self._environment, self.name, tx_id)

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
            position = Position(saved.block_number, saved.tx_id, must_be_reached=True)
        elif start_block is not None or after_transaction_id:
            position = Position(start_block, after_transaction_id)
        source = EventSource(self._environment, self.name, chaincode, position)
        return Stream(self._environment, source, reconnect=reconnect)

    def blocks(
        self, *, start_block: int | None = None, checkpointer: Checkpointer | None = None, reconnect: bool = False
    ) -> Stream[Block]:
        """Whole blocks: from now on, from a block on, or from where a checkpoint says.

        Save ``Checkpoint.after_block(block.number)``. Raises `CheckpointError` here; when opened,
        `UnknownTransactionError` for a checkpoint beyond the chain.
        """
        start, saved = _start(start_block, checkpointer)
        source = BlockSource(self._environment, self.name, start, must_be_reached=saved)
        return Stream(self._environment, source, reconnect=reconnect)

    def filtered_blocks(
        self, *, start_block: int | None = None, checkpointer: Checkpointer | None = None, reconnect: bool = False
    ) -> Stream[FilteredBlock]:
        """Outlines of blocks, as `blocks`."""
        start, saved = _start(start_block, checkpointer)
        source = FilteredBlockSource(self._environment, self.name, start, must_be_reached=saved)
        return Stream(self._environment, source, reconnect=reconnect)


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

        When the orderer's answer is lost, the outcome is asked for instead of sending anything twice. Raises
        `EndorseError`, `SubmitError`, `CommitStatusError`, `CommitError`, `CommitUnknownError`, each with `tx_id`.
        """
        proposal = self.propose(
            function, *arguments, transient=transient, endorsing_organizations=endorsing_organizations
        )
        transaction = await proposal.endorse()
        lost: SubmitError | None = None
        try:
            commit = await transaction.submit()
        except SubmitError as error:
            if not error.outcome_unknown:
                raise
            lost, commit = error, transaction.commit
        status = await self._outcome(commit, lost)
        status.require_valid()
        return Submitted(transaction.tx_id, status.block_number, transaction.payload)

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
        peers disagreed because they stood at different blocks. An endorsement that was not enough is tried once more:
        another transaction of the same block may have made the key, and with it who must endorse. Nothing else is
        tried again.
        """
        backoff = Backoff(self._environment.random_bytes, first_s=0.02, max_s=1.0)
        unendorsed = False
        for _ in range(attempts - 1):
            try:
                return await self.submit(
                    function, *arguments, transient=transient, endorsing_organizations=endorsing_organizations
                )
            except CommitError as error:
                lacking = error.code == ValidationCode.ENDORSEMENT_POLICY_FAILURE
                if not error.is_conflict and (unendorsed or not lacking):
                    raise
                unendorsed = unendorsed or lacking
            except EndorseError as error:
                if not error.is_mismatch:
                    raise
            await asyncio.sleep(backoff.next_s())
        return await self.submit(
            function, *arguments, transient=transient, endorsing_organizations=endorsing_organizations
        )

    async def _outcome(self, commit: Commit, lost: SubmitError | None) -> CommitStatus:
        """The outcome, asked for again through interruptions until the deadline; asking changes nothing."""
        loop = asyncio.get_running_loop()
        limit_s = self._environment.calls.deadlines.commit_status_s
        deadline = loop.time() + limit_s
        backoff = Backoff(self._environment.random_bytes)
        while True:
            try:
                return await commit.status(timeout_s=max(0.001, deadline - loop.time()))
            except CommitStatusError as error:
                pause_s = backoff.next_s()
                again = error.status_code in _WORTH_ASKING_AGAIN and loop.time() + pause_s < deadline
                if not again:
                    if error.status_code not in _WORTH_ASKING_AGAIN | {grpc.StatusCode.DEADLINE_EXCEEDED}:
                        raise
                    sent = "it was handed over" if lost is None else f"whether it arrived is unknown ({lost.message})"
                    raise CommitUnknownError(
                        f"no outcome within {limit_s:g} s; {sent}. Ask again with the transaction id; a second "
                        "attempt may do the same thing twice",
                        tx_id=commit.tx_id,
                        status_code=error.status_code,
                        details=error.details,
                    ) from error
            await asyncio.sleep(pause_s)


def _start(start_block: int | None, checkpointer: Checkpointer | None) -> tuple[int | None, bool]:
    """The block to begin with, and whether a checkpoint says so."""
    saved = checkpointer.load() if checkpointer else None
    return (start_block, False) if saved is None else (saved.block_number, True)
