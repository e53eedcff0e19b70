"""Events that a contract sets, in the order of the chain, from any place on.

A trap of Fabric's own interface is not passed on: asked to continue after a transaction that is not on the chain,
or that set no event, a peer sends nothing, for ever. Here the transaction is looked up first, and what comes at or
before it in its block is left out on this side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import grpc
from fabric_protos.gateway import gateway_pb2

from wonderland_fabric_gateway.checkpoints import Checkpoint
from wonderland_fabric_gateway.gateway.calls import unusable_channel_is_an_error
from wonderland_fabric_gateway.gateway.commit import new_commit
from wonderland_fabric_gateway.gateway.deliver import FilteredBlock, Patience, height, read_filtered_block
from wonderland_fabric_gateway.gateway.errors import (
    CommitStatusError,
    MalformedError,
    StreamError,
    UnknownTransactionError,
)
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from wonderland_fabric_gateway.gateway.calls import Environment


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a valid, committed transaction."""

    block_number: int
    tx_id: str
    chaincode: str
    name: str
    payload: bytes

    @property
    def checkpoint(self) -> Checkpoint:
        """What to save when this event has been dealt with."""
        return Checkpoint(self.block_number, self.tx_id)


class EventSource:
    """A contract's events after `position` (None: from now on); a source for `streams.Stream`."""

    def __init__(self, channel: str, chaincode: str, position: Position | None) -> None:
        self._channel = channel
        self._chaincode = chaincode
        self._position = position
        self._patience = Patience()
        self._left_out: frozenset[str] = frozenset()

    async def open(self, environment: Environment) -> Any:
        """A call on which events arrive. Raises `UnknownTransactionError`, `StreamError`."""
        start = await self._locate(environment)
        self._patience = Patience()
        request = gateway_pb2.ChaincodeEventsRequest(
            channel_id=self._channel, chaincode_id=self._chaincode, identity=environment.identity.creator
        )
        request.start_position.specified.number = start
        message = request.SerializeToString()
        signed = gateway_pb2.SignedChaincodeEventsRequest(request=message, signature=environment.sign(message, ""))
        with unusable_channel_is_an_error(StreamError):
            return environment.calls.open_chaincode_events(signed)

    def items(self, answer: bytes) -> Iterator[Event]:
        """The events of one block. Raises `MalformedError`."""
        message = decode(gateway_pb2.ChaincodeEventsResponse, answer, "the gateway's answer", MalformedError)
        number = int(message.block_number)
        for event in message.events:
            if event.tx_id not in self._left_out:
                yield Event(number, event.tx_id, event.chaincode_id, event.event_name, event.payload)

    def delivered(self, item: Event) -> None:
        """Note that the consumer has it."""
        self._position = Position(item.block_number, item.tx_id, exact=True)

    async def _locate(self, environment: Environment) -> int:
        """The block to begin with; sets what is to be left out of it."""
        channel = self._channel
        if self._position is None:
            self._position = Position(await height(environment, channel), "")
        position = self._position
        if not position.tx_id:
            number = position.block_number or 0
            if position.exact:
                blocks = await height(environment, channel)
                if number > blocks:
                    raise self._patience.behind(environment, channel, Checkpoint(number), blocks)
            return number
        block = await (self._exact_block if position.exact else self._block_of)(environment, position)
        ids = [transaction.tx_id for transaction in block.transactions]
        self._left_out = frozenset(ids[: ids.index(position.tx_id) + 1])
        return block.number

    async def _exact_block(self, environment: Environment, position: Position) -> FilteredBlock:
        """The block that a checkpoint names, as soon as this peer has it."""
        number = position.block_number or 0
        block = await read_filtered_block(environment, self._channel, number)
        if block is None:
            blocks = await height(environment, self._channel)
            raise self._patience.behind(environment, self._channel, Checkpoint(number, position.tx_id), blocks)
        if not _holds(block, position.tx_id):
            raise _unknown(position, self._channel, f"block {number} does not hold it")
        return block

    async def _block_of(self, environment: Environment, position: Position) -> FilteredBlock:
        channel = self._channel
        if position.block_number is not None:
            block = await read_filtered_block(environment, channel, position.block_number)
            if block is not None and _holds(block, position.tx_id):
                return block
        else:
            await height(environment, channel)  # a ledger that answers: what follows is about the transaction
        limit_s = environment.calls.deadlines.locate_s
        try:
            status = await new_commit(environment, channel, position.tx_id).status(timeout_s=limit_s)
        except CommitStatusError as cause:
            if cause.status_code is grpc.StatusCode.DEADLINE_EXCEEDED:
                raise _unknown(position, channel, f"nothing was found within {limit_s:g} s") from cause
            if cause.status_code is grpc.StatusCode.NOT_FOUND:
                raise _unknown(position, channel, cause.message) from cause
            raise StreamError(
                f"the place to continue could not be looked up: {cause.message}",
                tx_id=position.tx_id,
                status_code=cause.status_code,
            ) from cause
        if position.block_number is not None and status.block_number < position.block_number:
            raise _unknown(position, channel, f"it is in block {status.block_number}, before the start")
        block = await read_filtered_block(environment, channel, status.block_number)
        if block is None or not _holds(block, position.tx_id):
            raise _unknown(position, channel, f"block {status.block_number} does not hold it")
        return block


@dataclass(frozen=True, slots=True)
class Position:
    """Where to begin: at a block, after a transaction, or both.

    `exact`: it was seen on the chain, so the chain is that long, and that block holds that transaction.
    """

    block_number: int | None
    tx_id: str
    exact: bool = False


def _holds(block: FilteredBlock, tx_id: str) -> bool:
    return any(transaction.tx_id == tx_id for transaction in block.transactions)


def _unknown(position: Position, channel: str, why: str) -> UnknownTransactionError:
    place = "" if position.block_number is None else f" from block {position.block_number} on"
    return UnknownTransactionError(
        f"there is no transaction {position.tx_id} on channel {channel}{place} to continue after ({why}); "
        "the ledger was set up anew, or the checkpoint is of another one. Remove the checkpoint to begin anew",
        tx_id=position.tx_id,
        status_code=grpc.StatusCode.NOT_FOUND,
    )
