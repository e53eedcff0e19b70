"""What streams show of a stored block: its events, its filtered form, its header alone.

The blocks are this ledger's own, so they are taken apart without the checks that foreign bytes get.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from fabric_protos.common import common_pb2
from fabric_protos.peer import (
    chaincode_event_pb2,
    events_pb2,
    proposal_pb2,
    proposal_response_pb2,
    transaction_pb2,
)
from google.protobuf.message import DecodeError


def chaincode_events(raw: bytes) -> list[tuple[str, str, bytes]]:
    """Transaction id, chaincode and encoded ``ChaincodeEvent`` of each valid transaction that set one, in order."""
    block = common_pb2.Block.FromString(raw)
    codes = block.metadata.metadata[common_pb2.TRANSACTIONS_FILTER]
    found: list[tuple[str, str, bytes]] = []
    for envelope, code in zip(block.data.data, codes, strict=True):
        payload = common_pb2.Payload.FromString(common_pb2.Envelope.FromString(envelope).payload)
        header = common_pb2.ChannelHeader.FromString(payload.header.channel_header)
        if code == transaction_pb2.VALID and header.type == common_pb2.ENDORSER_TRANSACTION:
            for action in _actions(payload):
                if action.events:
                    event = chaincode_event_pb2.ChaincodeEvent.FromString(action.events)
                    found.append((event.tx_id, event.chaincode_id, action.events))
    return found


def filtered_block_response(raw: bytes, channel: str) -> bytes:
    """``protos.DeliverResponse`` with the filtered block: ids, types, codes, and events without their payloads."""
    block = common_pb2.Block.FromString(raw)
    codes = block.metadata.metadata[common_pb2.TRANSACTIONS_FILTER]
    filtered = events_pb2.FilteredBlock(channel_id=channel, number=block.header.number)
    for envelope, code in zip(block.data.data, codes, strict=True):
        payload = common_pb2.Payload.FromString(common_pb2.Envelope.FromString(envelope).payload)
        header = common_pb2.ChannelHeader.FromString(payload.header.channel_header)
        transaction = filtered.filtered_transactions.add(txid=header.tx_id, type=header.type, tx_validation_code=code)
        if header.type != common_pb2.ENDORSER_TRANSACTION:
            continue
        transaction.transaction_actions.SetInParent()
        # As on Fabric, also the events of invalid transactions: what did not happen is told by the code. Those may
        # hold anything; their contents are only opened as far as they can be.
        with contextlib.suppress(DecodeError):
            for action in _actions(payload):
                if action.events:
                    event = chaincode_event_pb2.ChaincodeEvent.FromString(action.events)
                    event.payload = b""
                    transaction.transaction_actions.chaincode_actions.add(chaincode_event=event)
    return bytes(events_pb2.DeliverResponse(filtered_block=filtered).SerializeToString())


def header_only(raw: bytes) -> bytes:
    """The block without its transactions, except a config block, which stays whole."""
    block = common_pb2.Block.FromString(raw)
    if len(block.data.data) == 1:
        payload = common_pb2.Payload.FromString(common_pb2.Envelope.FromString(block.data.data[0]).payload)
        if common_pb2.ChannelHeader.FromString(payload.header.channel_header).type == common_pb2.CONFIG:
            return raw
    block.ClearField("data")
    return bytes(block.SerializeToString())


def length_delimited(field: int, data: bytes) -> bytes:
    """One protocol-buffer field of type message or bytes, so that a large block is not parsed to be wrapped."""
    head = bytearray((field << 3 | 2,))
    length = len(data)
    while length >= 0x80:
        head.append(length & 0x7F | 0x80)
        length >>= 7
    head.append(length)
    return bytes(head) + data


def _actions(payload: common_pb2.Payload) -> Iterator[proposal_pb2.ChaincodeAction]:
    for entry in transaction_pb2.Transaction.FromString(payload.data).actions:
        endorsed = transaction_pb2.ChaincodeActionPayload.FromString(entry.payload).action
        response = proposal_response_pb2.ProposalResponsePayload.FromString(endorsed.proposal_response_payload)
        yield proposal_pb2.ChaincodeAction.FromString(response.extension)
