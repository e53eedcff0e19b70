"""Blocks of Fabric as plain, frozen Python: header, hashes, transactions, what each read and wrote, and its event.

Nothing here checks a signature; it checks form, the data hash, and offers the header hash for the chain. Sources:
``common.Block`` and what it carries; the header hash is SHA-256 over ASN.1 DER ``SEQUENCE {INTEGER number,
OCTET STRING previous_hash, OCTET STRING data_hash}``; the data hash is SHA-256 over the concatenated envelopes.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.common import common_pb2

from wonderland_fabric_gateway.errors import BlockError, IdentityError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.transactions import Transaction, TransactionType, ValidationCode, parse_transaction

if TYPE_CHECKING:
    from wonderland_fabric_gateway.channel_config import ChannelConfig

__all__ = [
    "Block",
    "BlockHeader",
    "BlockSignature",
    "Transaction",
    "TransactionType",
    "ValidationCode",
    "block_signature",
    "block_signatures",
    "data_hash",
    "parse_block",
]

HASH_BYTES: Final = 32
MAX_BLOCK_BYTES: Final = 100 << 20
MAX_TRANSACTIONS: Final = 100_000
MAX_SIGNATURES: Final = 1_000


@dataclass(frozen=True, slots=True)
class BlockHeader:
    """Number, and the two hashes that chain blocks; `previous_hash` of block 0 is empty."""

    number: int
    previous_hash: bytes
    data_hash: bytes

    @property
    def der(self) -> bytes:
        """The DER encoding that is hashed, and that the orderers sign."""
        number = self.number.to_bytes(self.number.bit_length() // 8 + 1, "big")
        body = b"".join(
            (_tagged(0x02, number), _tagged(0x04, self.previous_hash), _tagged(0x04, self.data_hash)),
        )
        return _tagged(0x30, body)

    @property
    def hash(self) -> bytes:
        """SHA-256 of `der`: the next block's `previous_hash`."""
        return hashlib.sha256(self.der).digest()


@dataclass(frozen=True, slots=True)
class Block:
    """A block, its transactions parsed and in order. `envelopes` and `metadata` are its bytes as they came."""

    header: BlockHeader
    transactions: tuple[Transaction, ...]
    envelopes: tuple[bytes, ...]
    metadata: tuple[bytes, ...]

    @property
    def number(self) -> int:
        """The block's number, from 0."""
        return self.header.number

    @property
    def header_hash(self) -> bytes:
        """SHA-256 that the next block names as its `previous_hash`."""
        return self.header.hash

    @property
    def config(self) -> ChannelConfig | None:
        """The channel configuration that this block brings, or None."""
        for transaction in self.transactions:
            if transaction.config is not None:
                return transaction.config
        return None

    def require_follows(self, previous: BlockHeader) -> None:
        """Raise `BlockError` unless this is the very next block after `previous` in one hash chain."""
        if self.number != previous.number + 1:
            raise BlockError(f"block {self.number} came after {previous.number}; {previous.number + 1} is missing")
        if self.header.previous_hash != previous.hash:
            raise BlockError(f"block {self.number} does not continue the chain: its previous_hash is of another block")

    def to_bytes(self) -> bytes:
        """The block as ``common.Block``, for storage and evidence."""
        header = common_pb2.BlockHeader(
            number=self.header.number, previous_hash=self.header.previous_hash, data_hash=self.header.data_hash
        )
        data = common_pb2.BlockData(data=self.envelopes)
        metadata = common_pb2.BlockMetadata(metadata=self.metadata)
        return bytes(common_pb2.Block(header=header, data=data, metadata=metadata).SerializeToString())


@dataclass(frozen=True, slots=True)
class BlockSignature:
    """An orderer's signature. `message` is what it signs; BFT orderers go by a number instead of an identity."""

    signer: Identity | None
    consenter_id: int | None
    message: bytes
    signature: bytes


def parse_block(block: bytes | Any) -> Block:
    """Parse a block from its bytes or from a ``common.Block`` message. Raises `BlockError`.

    The data hash is checked. A malformed transaction that the peers marked invalid becomes a Transaction of type
    `malformed`, since such things are on real chains; one that they marked valid is refused.
    """
    if isinstance(block, bytes):
        if len(block) > MAX_BLOCK_BYTES:
            raise BlockError(f"a block of {len(block)} bytes; the limit is {MAX_BLOCK_BYTES}")
        block = decode(common_pb2.Block, block, "block", BlockError)
    header = _header(block.header)
    envelopes = tuple(block.data.data)
    metadata = tuple(block.metadata.metadata)
    if not 0 < len(envelopes) <= MAX_TRANSACTIONS:
        raise BlockError(f"block {header.number} has {len(envelopes)} transactions, not 1 to {MAX_TRANSACTIONS}")
    if data_hash(envelopes) != header.data_hash:
        raise BlockError(f"block {header.number}: the transactions are not those that its header's data_hash is of")
    codes = _validation_codes(header.number, metadata, len(envelopes))
    try:
        transactions = tuple(
            parse_transaction(envelope, index, code)
            for index, (envelope, code) in enumerate(zip(envelopes, codes, strict=True))
        )
    except BlockError as cause:
        raise BlockError(f"block {header.number}, {cause}") from cause
    return Block(header=header, transactions=transactions, envelopes=envelopes, metadata=metadata)


def data_hash(envelopes: tuple[bytes, ...] | list[bytes]) -> bytes:
    """SHA-256 over the concatenated envelopes: a header's `data_hash`."""
    digest = hashlib.sha256()
    for envelope in envelopes:
        digest.update(envelope)
    return digest.digest()


def block_signatures(block: Block) -> tuple[BlockSignature, ...]:
    """The orderers' signatures in metadata slot SIGNATURES, each with the message it is over. Raises `BlockError`."""
    what = f"block {block.number}: signatures"
    slot = block.metadata[common_pb2.SIGNATURES] if block.metadata else b""
    message = decode(common_pb2.Metadata, slot, what, BlockError)
    if len(message.signatures) > MAX_SIGNATURES:
        raise BlockError(f"{what}: {len(message.signatures)} of them; the limit is {MAX_SIGNATURES}")
    return tuple(block_signature(each, message.value, block.header.der, what) for each in message.signatures)


def block_signature(entry: Any, value: bytes, header_der: bytes, what: str) -> BlockSignature:
    """One ``common.MetadataSignature`` over a block's metadata value and its header's DER. Raises `BlockError`."""
    if entry.identifier_header:
        identifier = decode(common_pb2.IdentifierHeader, entry.identifier_header, what, BlockError)
        message = value + entry.identifier_header + header_der
        return BlockSignature(None, int(identifier.identifier), message, entry.signature)
    signature_header = decode(common_pb2.SignatureHeader, entry.signature_header, what, BlockError)
    try:
        signer = Identity.from_creator(signature_header.creator)
    except IdentityError as cause:
        raise BlockError(f"{what}: {cause}") from cause
    return BlockSignature(signer, None, value + entry.signature_header + header_der, entry.signature)


def _header(message: Any) -> BlockHeader:
    header = BlockHeader(int(message.number), message.previous_hash, message.data_hash)
    if len(header.data_hash) != HASH_BYTES:
        raise BlockError(f"block {header.number}: a data_hash of {len(header.data_hash)} bytes, not {HASH_BYTES}")
    if len(header.previous_hash) != (HASH_BYTES if header.number else 0):
        raise BlockError(f"block {header.number}: a previous_hash of {len(header.previous_hash)} bytes")
    return header


def _validation_codes(number: int, metadata: tuple[bytes, ...], transactions: int) -> bytes:
    """One byte per transaction. A block that no peer has validated yet (block 0, an orderer's) has none."""
    codes = metadata[common_pb2.TRANSACTIONS_FILTER] if len(metadata) > common_pb2.TRANSACTIONS_FILTER else b""
    if not codes:
        return bytes([ValidationCode.VALID if number == 0 else ValidationCode.NOT_VALIDATED] * transactions)
    if len(codes) != transactions:
        raise BlockError(f"block {number}: {len(codes)} validation codes for {transactions} transactions")
    return codes


def _tagged(tag: int, body: bytes) -> bytes:
    """DER tag-length-value; every length here is below 128."""
    return bytes((tag, len(body))) + body
