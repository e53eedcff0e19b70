"""Blocks from a peer's Deliver service: whole or filtered, as streams or one at a time.

A filtered block tells ids, codes and the names of events, without payloads. Sources: ``orderer/ab.proto``
(SeekInfo), ``peer/events.proto`` (Deliver).
"""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

import grpc
from fabric_protos.common import common_pb2
from fabric_protos.orderer import ab_pb2
from fabric_protos.peer import events_pb2

from wonderland_fabric_gateway.blocks import Block, BlockHeader, parse_block
from wonderland_fabric_gateway.checkpoints import MAX_BLOCK_NUMBER, Checkpoint
from wonderland_fabric_gateway.gateway.calls import cancelled_from_outside, unusable_channel_is_an_error
from wonderland_fabric_gateway.gateway.errors import (
    BehindError,
    MalformedError,
    StreamError,
    UnknownTransactionError,
    from_rpc,
)
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.transactions import code_name

if TYPE_CHECKING:
    from collections.abc import Iterator

    from wonderland_fabric_gateway.gateway.calls import Environment

AnyBlock = TypeVar("AnyBlock", Block, "FilteredBlock")

_NONCE_BYTES: Final = 24
_STATUS_CODES: Final = {
    common_pb2.BAD_REQUEST: grpc.StatusCode.INVALID_ARGUMENT,
    common_pb2.FORBIDDEN: grpc.StatusCode.PERMISSION_DENIED,
    common_pb2.NOT_FOUND: grpc.StatusCode.NOT_FOUND,
    common_pb2.REQUEST_ENTITY_TOO_LARGE: grpc.StatusCode.RESOURCE_EXHAUSTED,
    common_pb2.INTERNAL_SERVER_ERROR: grpc.StatusCode.INTERNAL,
    common_pb2.NOT_IMPLEMENTED: grpc.StatusCode.UNIMPLEMENTED,
    common_pb2.SERVICE_UNAVAILABLE: grpc.StatusCode.UNAVAILABLE,
}


@dataclass(frozen=True, slots=True)
class FilteredEvent:
    """That a contract set an event; its payload is not in a filtered block."""

    chaincode: str
    name: str


@dataclass(frozen=True, slots=True)
class FilteredTransaction:
    """A transaction's id, header type (3 is an endorser transaction), validation code and events."""

    tx_id: str
    type: int
    validation_code: int
    events: tuple[FilteredEvent, ...]

    @property
    def validation_name(self) -> str:
        """The validation code's name: VALID, MVCC_READ_CONFLICT and so on."""
        return code_name(self.validation_code)


@dataclass(frozen=True, slots=True)
class FilteredBlock:
    """A block's outline: number, channel, transactions in order."""

    number: int
    channel: str
    transactions: tuple[FilteredTransaction, ...]

    @property
    def checkpoint(self) -> Checkpoint:
        """What to save when this block has been dealt with."""
        return Checkpoint.after_block(self.number)


class Patience:
    """How long to believe that a chain which is shorter than what was seen of it is still catching up.

    As long as it grows, and `catch_up_s` beyond that: another peer of the organisation may be behind the one that
    was asked before, while the chain of another ledger stands still, or is found to be another when it has grown.
    """

    def __init__(self) -> None:
        self._highest = -1
        self._since_s = 0.0

    def behind(self, environment: Environment, channel: str, checkpoint: Checkpoint, blocks: int) -> StreamError:
        """What to raise about a chain of so many blocks: `BehindError`, or in the end `UnknownTransactionError`."""
        now_s = asyncio.get_running_loop().time()
        if blocks > self._highest:
            self._highest, self._since_s = blocks, now_s
        text = f"the checkpoint continues at block {checkpoint.block_number}, but channel {channel} has {blocks} blocks"
        if now_s - self._since_s < environment.calls.deadlines.catch_up_s:
            return BehindError(f"{text} so far", status_code=grpc.StatusCode.UNAVAILABLE)
        return UnknownTransactionError(
            f"{text} and gets no more: the ledger was set up anew, or this is another one (or its peers get nothing "
            "from the orderers; see `wonderland network status`). Remove the checkpoint to begin anew"
        )


class _Source:
    """Where a block stream stands: the next block, None before "from now on" has become a number."""

    def __init__(self, channel: str, next_block: int | None, *, must_be_reached: bool = False) -> None:
        self._channel = channel
        self._next = next_block
        self._must_be_reached = must_be_reached
        self._patience = Patience()

    async def _position(self, environment: Environment) -> Any:
        """The request that continues. "From now on" becomes a number the first time, so that none is missed."""
        if self._next is None:
            self._next = await height(environment, self._channel)
        elif self._must_be_reached:
            checkpoint = Checkpoint(self._next)
            blocks = await height(environment, self._channel)
            if checkpoint.block_number > blocks:
                raise self._patience.behind(environment, self._channel, checkpoint, blocks)
            self._patience = Patience()
            self._must_be_reached = False
        return seek_request(environment, self._channel, start=self._next)

    def _note(self, delivered: int) -> None:
        self._next = delivered + 1
        self._must_be_reached = True  # opened again, a ledger that has become shorter is behind, or another one

    def _require_next(self, block: AnyBlock) -> AnyBlock:
        if block.number != self._next:
            raise StreamError(f"the peer sent block {block.number} instead of {self._next}")
        return block


class BlockSource(_Source):
    """Whole blocks of a channel, each the successor of the one before; a source for `streams.Stream`."""

    _last: BlockHeader | None = None

    async def open(self, environment: Environment) -> Any:
        """A new call. Raises `StreamError`, `UnknownTransactionError`."""
        request = await self._position(environment)
        with unusable_channel_is_an_error(StreamError):
            call = environment.calls.open_deliver()
        await _send(call, request)
        return call

    def items(self, answer: bytes) -> Iterator[Block]:
        """The block of an answer, which must be the next one. Raises `BlockError`, `StreamError`."""
        message = _answer(answer)
        _require_block(message, "block")
        block = self._require_next(parse_block(message.block))
        if self._last is not None:
            block.require_follows(self._last)  # another peer has the same chain, or it is another ledger
        yield block

    def delivered(self, item: Block) -> None:
        """Note that the consumer has it."""
        self._last = item.header
        self._note(item.number)


class FilteredBlockSource(_Source):
    """Filtered blocks of a channel; a source for `streams.Stream`."""

    async def open(self, environment: Environment) -> Any:
        """A new call. Raises `StreamError`, `UnknownTransactionError`."""
        request = await self._position(environment)
        with unusable_channel_is_an_error(StreamError):
            call = environment.calls.open_deliver_filtered()
        await _send(call, request)
        return call

    def items(self, answer: bytes) -> Iterator[FilteredBlock]:
        """The filtered block of an answer, which must be the next one. Raises `StreamError`."""
        message = _answer(answer)
        _require_block(message, "filtered_block")
        yield self._require_next(_filtered(message.filtered_block))

    def delivered(self, item: FilteredBlock) -> None:
        """Note that the consumer has it."""
        self._note(item.number)


async def height(environment: Environment, channel: str) -> int:
    """How many blocks the channel has: the number of the next one. Raises `StreamError`."""
    newest = await read_filtered_block(environment, channel, None)
    if newest is None:
        raise StreamError(f"channel {channel} has no blocks", status_code=grpc.StatusCode.NOT_FOUND)
    return newest.number + 1


async def is_level(environment: Environment, channel: str, index: int, other: int) -> bool:
    """Whether a Gateway's peer has as many blocks as another one's. Raises `StreamError`."""
    wanted = await height(environment.at(other), channel)
    return await height(environment.at(index), channel) >= wanted


async def read_filtered_block(environment: Environment, channel: str, number: int | None) -> FilteredBlock | None:
    """One filtered block (None: the newest); None when the chain has not come that far. Raises `StreamError`."""
    for left in reversed(range(environment.calls.count)):
        pinned = environment.pinned()
        try:
            return await _read_one(pinned, channel, number)
        except StreamError as error:
            if not error.is_unreached:
                raise
            pinned.calls.pass_over()
            if not left:
                raise
    raise AssertionError("unreachable: the last Gateway answers or fails")


def seek_request(environment: Environment, channel: str, *, start: int | None, only: bool = False) -> Any:
    """A signed request for blocks from `start` (None: the newest) without end, or only for that one, if it is there."""
    seek = ab_pb2.SeekInfo(behavior=ab_pb2.SeekInfo.FAIL_IF_NOT_READY if only else ab_pb2.SeekInfo.BLOCK_UNTIL_READY)
    if start is None:
        seek.start.newest.SetInParent()
        seek.stop.newest.SetInParent()
    else:
        seek.start.specified.number = start
        seek.stop.specified.number = start if only else MAX_BLOCK_NUMBER
    channel_header = common_pb2.ChannelHeader(
        type=common_pb2.DELIVER_SEEK_INFO, channel_id=channel, tls_cert_hash=environment.tls_certificate_sha256
    )
    now_ns = environment.now_ns()
    channel_header.timestamp.seconds, channel_header.timestamp.nanos = divmod(now_ns, 1_000_000_000)
    signature_header = common_pb2.SignatureHeader(
        creator=environment.identity.creator, nonce=environment.random_bytes(_NONCE_BYTES)
    )
    payload = common_pb2.Payload(
        header=common_pb2.Header(
            channel_header=channel_header.SerializeToString(), signature_header=signature_header.SerializeToString()
        ),
        data=seek.SerializeToString(),
    ).SerializeToString()
    return common_pb2.Envelope(payload=payload, signature=environment.sign(payload, ""))


async def _read_one(environment: Environment, channel: str, number: int | None) -> FilteredBlock | None:
    with unusable_channel_is_an_error(StreamError):
        call = environment.calls.open_deliver_filtered(timeout=environment.calls.deadlines.locate_s)
    try:
        await _send(call, seek_request(environment, channel, start=number, only=True))
        answer = await call.read()
        if answer is grpc.aio.EOF:
            raise StreamError("the peer ended the stream without a block", status_code=grpc.StatusCode.UNAVAILABLE)
        message = _answer(answer)
        if message.WhichOneof("Type") == "status" and message.status == common_pb2.NOT_FOUND:
            return None
        _require_block(message, "filtered_block")
        return _filtered(message.filtered_block)
    except grpc.aio.AioRpcError as cause:
        raise from_rpc(cause, StreamError) from cause
    except asyncio.CancelledError as cause:
        if cancelled_from_outside():
            raise
        raise StreamError("the channel was closed", status_code=grpc.StatusCode.CANCELLED) from cause
    finally:
        call.cancel()


async def _send(call: Any, request: Any) -> None:
    # When the call has failed already, the read that follows says why.
    with contextlib.suppress(grpc.aio.AioRpcError):
        await call.write(request)


def _answer(data: Any) -> Any:
    return decode(events_pb2.DeliverResponse, data, "the peer's answer", MalformedError)


def _require_block(answer: Any, kind: str) -> None:
    found = answer.WhichOneof("Type")
    if found == kind:
        return
    if found != "status":
        raise StreamError(f"the peer sent {found or 'nothing'} instead of a {kind}")
    name = common_pb2.Status.Name(answer.status) if answer.status in common_pb2.Status.values() else answer.status
    # An unending request never succeeds: SUCCESS means that the peer is ending it.
    code = _STATUS_CODES.get(answer.status, grpc.StatusCode.UNAVAILABLE)
    raise StreamError(f"the peer ended the stream: {name}", status_code=code)


def _filtered(block: Any) -> FilteredBlock:
    return FilteredBlock(
        number=int(block.number),
        channel=block.channel_id,
        transactions=tuple(
            FilteredTransaction(
                tx_id=transaction.txid,
                type=int(transaction.type),
                validation_code=int(transaction.tx_validation_code),
                events=tuple(
                    FilteredEvent(action.chaincode_event.chaincode_id, action.chaincode_event.event_name)
                    for action in transaction.transaction_actions.chaincode_actions
                    if action.chaincode_event.event_name
                ),
            )
            for transaction in block.filtered_transactions
        ),
    )
