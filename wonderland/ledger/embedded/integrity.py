"""Whether the stored chain is whole, looked at when the ledger starts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from wonderland.ledger.blocks import block_signatures, parse_block
from wonderland.ledger.embedded.errors import LedgerCorruptedError
from wonderland.ledger.errors import LedgerError
from wonderland.ledger.signing import verify

if TYPE_CHECKING:
    from wonderland.ledger.blocks import Block
    from wonderland.ledger.embedded.state import StateReader

CHECKED_BLOCKS: Final = 100


def verify_tip(reader: StateReader, depth: int = CHECKED_BLOCKS) -> None:
    """Check the last `depth` blocks: numbers, data hashes, header chain, orderer signatures, transaction index.

    Raises `LedgerCorruptedError` naming the block. An empty store passes.
    """
    tip = reader.tip()
    if reader.block_count() != tip.number + 1:
        raise LedgerCorruptedError(
            f"the chain ends with block {tip.number}, but only {reader.block_count()} are stored"
        )
    previous: Block | None = None
    for number in range(max(0, tip.number + 1 - depth), tip.number + 1):
        block = _load(reader, number)
        try:
            if previous is not None:
                block.require_follows(previous.header)
            for signature in block_signatures(block):
                if signature.signer is not None:
                    verify(signature.signer.public_key, signature.message, signature.signature)
        except LedgerError as cause:
            raise LedgerCorruptedError(f"stored block {number}: {cause}") from cause
        for transaction in block.transactions:
            if transaction.tx_id and reader.transaction(transaction.tx_id) is None:
                raise LedgerCorruptedError(f"transaction {transaction.tx_id} of block {number} is not in the index")
        previous = block
    if previous is not None and previous.header_hash != tip.header_hash:
        raise LedgerCorruptedError(f"block {tip.number} is not the one that its stored header hash is of")


def _load(reader: StateReader, number: int) -> Block:
    raw = reader.block(number)
    if raw is None:
        raise LedgerCorruptedError(f"block {number} is missing from the store")
    try:
        block = parse_block(raw)
    except LedgerError as cause:
        raise LedgerCorruptedError(f"stored block {number}: {cause}") from cause
    if block.number != number:
        raise LedgerCorruptedError(f"block {block.number} is stored where {number} should be")
    return block
