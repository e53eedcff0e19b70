"""What a transaction says in full, read from the ledger itself: arguments, reads, writes, endorsements.

The mirror keeps only what lists need; whoever opens a transaction sees the block as the ledger has it now.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from base64 import urlsafe_b64encode
from collections.abc import Callable
from typing import Any, Final

from wonderland.problems import said
from wonderland_backend.db.tables.ledger import VerdictRow
from wonderland_backend.errors import LedgerAway, NotFound, RowsDiffer
from wonderland_backend.mirror.source import BlockSource
from wonderland_fabric_gateway.blocks import Block, BlockSignature, block_signatures
from wonderland_fabric_gateway.errors import BlockError, IdentityError, LedgerError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.transactions import Invocation, NamespaceAccess

logger = logging.getLogger(__name__)

FETCH_TIMEOUT_S: Final = 15.0
MAX_TEXT: Final = 200_000
"""Longer values are cut: a page is for reading. Their length is said."""


async def fetch_block(source: BlockSource | None, number: int) -> Block:
    """The block as the ledger has it. Raises `LedgerAway` where the ledger cannot be asked just now."""
    if source is None:
        raise LedgerAway(said("no_ledger_here"))
    blocks = source.blocks(number)
    try:
        async with asyncio.timeout(FETCH_TIMEOUT_S):
            return await anext(blocks)
    except (LedgerError, TimeoutError, StopAsyncIteration) as cause:
        detail = str(cause) or "it did not answer in time"
        raise LedgerAway(said("block_not_to_be_had", block=number, why=detail)) from cause
    finally:
        with contextlib.suppress(LedgerError):
            await blocks.aclose()


async def require_committed(source: BlockSource | None, row: VerdictRow) -> None:
    """Raise `RowsDiffer` unless the valid transaction that a row names wrote this very record, `LedgerAway`."""
    block = await fetch_block(source, row.block)
    transaction = block.transactions[row.tx_index] if row.tx_index < len(block.transactions) else None
    if transaction is not None and transaction.is_valid and transaction.tx_id == row.tx_id:
        record = row.record.encode()
        accesses = transaction.invocation.accesses if transaction.invocation is not None else ()
        if any(write.value == record for each in accesses for write in each.writes):
            return
    logger.critical("the row of the verdict on session %s is not what block %d says", row.session_id, row.block)
    raise RowsDiffer(said("rows_differ"))


Shown = Callable[[str], str]
"""A text as whoever reads it may see it."""


def transaction_contents(block: Block, tx_index: int, shown: Shown) -> dict[str, Any]:
    """The TransactionContents of one transaction of a block. Raises `NotFound` where there is none."""
    if tx_index >= len(block.transactions):
        raise NotFound(said("no_such_transaction_in_block", block=block.number, tx_index=tx_index))
    transaction = block.transactions[tx_index]
    contents: dict[str, Any] = {"tx_id": transaction.tx_id, "block": block.number, "tx_index": tx_index}
    contents |= {"envelope_bytes": len(block.envelopes[tx_index]), "ordered_by": signatures(block)}
    if transaction.problem:
        contents["problem"] = transaction.problem
    if transaction.invocation is not None:
        contents |= _invocation(transaction.invocation, shown)
    if transaction.config is not None:
        contents["config"] = {
            "sequence": transaction.config.sequence,
            "organisations": sorted(transaction.config.organisations),
        }
    return contents


def _invocation(invocation: Invocation, shown: Shown) -> dict[str, Any]:
    return {
        "chaincode": invocation.chaincode,
        "chaincode_version": invocation.chaincode_version,
        "arguments": [_value(each, shown) for each in invocation.args],
        "response": {"status": invocation.response.status, "message": invocation.response.message},
        "result": _value(invocation.response.payload, shown),
        "endorsements": [
            _signer(each.endorser) | {"signature": _base64(each.signature)} for each in invocation.endorsements
        ],
        "proposal_sha256": invocation.proposal_hash.hex(),
        "accesses": [_access(each, shown) for each in invocation.accesses],
    } | ({"event": _event(invocation, shown)} if invocation.event is not None else {})


def _event(invocation: Invocation, shown: Shown) -> dict[str, Any]:
    event = invocation.event
    return {"name": event.name, "payload": _value(event.payload, shown)} if event is not None else {}


def _access(access: NamespaceAccess, shown: Shown) -> dict[str, Any]:
    return {
        "namespace": access.namespace,
        "reads": [
            {"key": _key(each.key)}
            | ({"block": each.version.block, "tx_index": each.version.transaction} if each.version is not None else {})
            for each in access.reads
        ],
        "writes": [
            {"key": _key(each.key), "deleted": True}
            if each.is_delete
            else {"key": _key(each.key), "value": _value(each.value, shown)}
            for each in access.writes
        ],
        "range_queries": [{"start": _key(each.start_key), "end": _key(each.end_key)} for each in access.range_queries],
    }


def signatures(block: Block) -> list[dict[str, Any]]:
    """Who ordered the block: identities, or (BFT) numbers of consenters."""
    try:
        return [_ordered(each) for each in block_signatures(block)]
    except BlockError as error:
        return [{"problem": str(error)}]


def _ordered(signature: BlockSignature) -> dict[str, Any]:
    if signature.signer is None:
        return {"consenter_id": signature.consenter_id}
    return _signer(signature.signer)


def _key(key: str) -> str:
    """A composite key as a path: Fabric separates its parts by U+0000, and ends ranges with U+10FFFF."""
    return key.strip("\0").replace("\0", "/") if key.startswith("\0") else key


def _signer(identity: Identity) -> dict[str, Any]:
    try:
        return {
            "msp_id": identity.msp_id,
            "name": identity.common_name,
            "certificate_sha256": identity.certificate_sha256,
        }
    except IdentityError as error:
        return {"msp_id": identity.msp_id, "name": "", "certificate_sha256": "", "problem": str(error)}


def _value(value: bytes, shown: Shown) -> dict[str, Any]:
    """Text where it is text, else base64url; never more than a page can show."""
    found: dict[str, Any] = {"bytes": len(value)}
    try:
        whole = value.decode()
    except UnicodeDecodeError:
        return found | {"base64": _base64(value[:MAX_TEXT])}
    text = shown(whole)
    return found | {"text": text[:MAX_TEXT]} | ({"masked": True} if text != whole else {})


def _base64(value: bytes) -> str:
    return urlsafe_b64encode(value).rstrip(b"=").decode()
