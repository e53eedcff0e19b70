"""Streams: blocks (full, filtered, with private data) and chaincode events, from any point on, as they are committed.

The right to read is looked at before every block: a stream of somebody who was revoked ends with FORBIDDEN.
Sources: Fabric ``common/deliver``, ``core/peer/deliverevents.go``, ``internal/pkg/gateway/chaincodeevents.go``.
"""

from __future__ import annotations

import contextlib
from collections import OrderedDict
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.orderer import ab_pb2
from fabric_protos.peer import chaincode_event_pb2, events_pb2

from wonderland_fabric_gateway.embedded.block_views import (
    chaincode_events,
    filtered_block_response,
    header_only,
    length_delimited,
)
from wonderland_fabric_gateway.embedded.errors import (
    AccessDeniedError,
    LedgerOverloadedError,
    LedgerUnavailableError,
    MalformedRequestError,
    ProposalRefusedError,
)
from wonderland_fabric_gateway.embedded.proposals import require_recent, timestamp_ms
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator

    from wonderland_fabric_gateway.embedded.chain import Chain

CACHED_BLOCKS: Final = 64
MAX_STREAMS: Final = 1000
_UNENDING: Final = (1 << 64) - 1
_BLOCK_FIELD: Final = 2  # of protos.DeliverResponse
_PRIVATE_FIELD: Final = 4


class _Refused(Exception):  # noqa: N818 - not an error of ours: it carries the status that ends the stream
    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


class DeliverService:
    """The protos.Deliver service and the event stream of gateway.Gateway."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._streams = 0
        self._filtered = _Cache(filtered_block_response)
        self._events = _Cache(lambda raw, _: chaincode_events(raw))

    async def deliver(self, requests: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
        """Full blocks."""
        async for response in self._serve(requests, lambda _, raw: length_delimited(_BLOCK_FIELD, raw)):
            yield response

    async def deliver_filtered(self, requests: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
        """Blocks without contents: ids, codes, and events without payloads."""
        channel = self._chain.settings.channel
        async for response in self._serve(requests, lambda number, raw: self._filtered.of(number, raw, channel)):
            yield response

    async def deliver_with_private_data(self, requests: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
        """Full blocks in the message that has room for private data, of which there is none here."""
        async for response in self._serve(
            requests, lambda _, raw: length_delimited(_PRIVATE_FIELD, length_delimited(1, raw))
        ):
            yield response

    async def chaincode_events(self, data: bytes) -> AsyncIterator[bytes]:
        """SignedChaincodeEventsRequest → ChaincodeEventsResponse for each block with events of that chaincode.

        The first item is empty: the place in the chain is fixed, the stream is open.
        """
        signed = _decode(gateway_pb2.SignedChaincodeEventsRequest, data, "chaincode events request")
        if not signed.request:
            raise MalformedRequestError("a chaincode events request is required")
        request = _decode(gateway_pb2.ChaincodeEventsRequest, signed.request, "chaincode events request")
        chain = self._chain
        if request.channel_id != chain.settings.channel:
            raise ProposalRefusedError(
                f"channel {request.channel_id[:80]!r} not found; this ledger has {chain.settings.channel!r}"
            )
        member = chain.membership.application_member(request.identity, chain.settings.clock())
        member.verify(signed.request, signed.signature)
        number = self._first_event_block(request)
        after: str = request.after_transaction_id
        with self._counted():
            yield b""
            while True:
                await chain.wait_for_block(number)
                chain.membership.application_member(request.identity, chain.settings.clock())
                found = []
                for tx_id, chaincode, event in self._events.of(number, self._block(number), ""):
                    if after:
                        # As on Fabric: everything up to and including that transaction's event is passed over.
                        after = "" if tx_id == after else after
                    elif chaincode == request.chaincode_id:
                        found.append(event)
                if found:
                    yield gateway_pb2.ChaincodeEventsResponse(
                        block_number=number,
                        events=[chaincode_event_pb2.ChaincodeEvent.FromString(event) for event in found],
                    ).SerializeToString()
                number += 1

    def _first_event_block(self, request: Any) -> int:
        if request.after_transaction_id:
            location = self._chain.reader.transaction(request.after_transaction_id)
            if location is not None:
                return location.block
        kind = request.start_position.WhichOneof("Type")
        if kind == "specified":
            return int(request.start_position.specified.number)
        if kind in {None, "next_commit"}:
            return self._chain.height
        raise MalformedRequestError(f"invalid start position type: {kind}")

    async def _serve(
        self, requests: AsyncIterator[bytes], encode: Callable[[int, bytes], bytes]
    ) -> AsyncIterator[bytes]:
        """One seek after another, each answered with blocks and a final status."""
        with self._counted():
            async for data in requests:
                status = common_pb2.SUCCESS
                try:
                    async for number, raw in self._seek(data):
                        yield encode(number, raw)
                except _Refused as refused:
                    status = refused.status
                except LedgerUnavailableError:
                    status = common_pb2.SERVICE_UNAVAILABLE
                yield events_pb2.DeliverResponse(status=status).SerializeToString()
                if status != common_pb2.SUCCESS:
                    return

    async def _seek(self, data: bytes) -> AsyncIterator[tuple[int, bytes]]:
        """Block numbers and bytes for one signed seek. Raises `_Refused`, `LedgerUnavailableError`."""
        chain = self._chain
        creator, seek = self._open_seek(data)
        number, last = self._span(seek)
        while number <= last:
            if number >= chain.height:
                if seek.behavior == ab_pb2.SeekInfo.FAIL_IF_NOT_READY:
                    raise _Refused(common_pb2.NOT_FOUND)
                await chain.wait_for_block(number)
            self._require_reader(creator)
            raw = self._block(number)
            yield number, header_only(raw) if seek.content_type == ab_pb2.SeekInfo.HEADER_WITH_SIG else raw
            number += 1

    def _open_seek(self, data: bytes) -> tuple[bytes, Any]:
        """The sender of a seek and what it asks for, after all checks. Raises `_Refused`."""
        chain = self._chain
        try:
            envelope = _decode(common_pb2.Envelope, data, "seek")
            payload = _decode(common_pb2.Payload, envelope.payload, "seek payload")
            channel = _decode(common_pb2.ChannelHeader, payload.header.channel_header, "channel header")
            sender = _decode(common_pb2.SignatureHeader, payload.header.signature_header, "signature header")
            seek = _decode(ab_pb2.SeekInfo, payload.data, "seek info")
            require_recent(timestamp_ms(channel.timestamp), chain.settings.clock())
        except (MalformedRequestError, ProposalRefusedError) as error:
            raise _Refused(common_pb2.BAD_REQUEST) from error
        if channel.channel_id != chain.settings.channel:
            raise _Refused(common_pb2.NOT_FOUND)
        try:
            member = chain.membership.application_member(sender.creator, chain.settings.clock())
            member.verify(envelope.payload, envelope.signature)
        except AccessDeniedError as error:
            raise _Refused(common_pb2.FORBIDDEN) from error
        if not seek.HasField("start") or not seek.HasField("stop"):
            raise _Refused(common_pb2.BAD_REQUEST)
        return sender.creator, seek

    def _span(self, seek: Any) -> tuple[int, int]:
        """First and last block of a seek. Raises `_Refused`."""
        height = self._chain.height
        starts = {"newest": height - 1, "oldest": 0, "specified": seek.start.specified.number, "next_commit": height}
        kind = seek.start.WhichOneof("Type")
        if kind not in starts:
            raise _Refused(common_pb2.BAD_REQUEST)
        start = int(starts[kind])
        stop_kind = seek.stop.WhichOneof("Type")
        stops = {"newest": max(start, height - 1), "oldest": start, "specified": seek.stop.specified.number}
        stop = int(stops.get(stop_kind, _UNENDING))
        if stop < start:
            raise _Refused(common_pb2.BAD_REQUEST)
        return start, stop

    def _require_reader(self, creator: bytes) -> None:
        try:
            self._chain.membership.application_member(creator, self._chain.settings.clock())
        except AccessDeniedError as error:
            raise _Refused(common_pb2.FORBIDDEN) from error

    def _block(self, number: int) -> bytes:
        raw = self._chain.block(number)
        if raw is None:
            raise LedgerUnavailableError(f"block {number} cannot be read from the store")
        return raw

    @contextlib.contextmanager
    def _counted(self) -> Iterator[None]:
        if self._streams >= MAX_STREAMS:
            raise LedgerOverloadedError(f"{MAX_STREAMS} streams are open; close some")
        self._streams += 1
        try:
            yield
        finally:
            self._streams -= 1


class _Cache:
    """What was made of recent blocks, shared by all streams that follow the chain."""

    def __init__(self, make: Callable[[bytes, str], Any]) -> None:
        self._make = make
        self._items: OrderedDict[int, Any] = OrderedDict()

    def of(self, number: int, raw: bytes, channel: str) -> Any:
        item = self._items.get(number)
        if item is None:
            item = self._items[number] = self._make(raw, channel)
            if len(self._items) > CACHED_BLOCKS:
                self._items.popitem(last=False)
        return item


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, MalformedRequestError)
