"""The ledger's own seal over its tables: whoever edits rows without the ledger's secret cannot make it fit again.

For each table the keyed hashes of all its rows are added up (HMAC-SHA256, modulo 2²⁵⁶), so that a block changes the sum
by its own rows alone and the order of rows does not matter. The sums are never stored: with each block a keyed hash is
stored over its number, its hash and each sum. Source of the construction: Clarke, Devadas et al., "Incremental Multiset
Hash Functions" (2003), MSet-Add-Hash. What the contract reads is held against the same hashes at once (`known_rows`).
"""

from __future__ import annotations

import hmac
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.embedded.known_rows import NO_ROW, KnownRows

if TYPE_CHECKING:
    from collections.abc import Sequence

TABLES: Final = ("block", "tx", "state", "history", "meta")
SEAL: Final = "seal"
"""The row of `meta` that has the seal; the only one that is not under it."""
KEY_BYTES: Final = 32
_BY_KEY: Final = frozenset({"state", "history"})
_MODULUS: Final = 1 << 256
_TAG_BYTES: Final = 32
_NUMBER_BYTES: Final = 8

Row = tuple[str | bytes | int | None, ...]
"""A row as SQLite gives it."""


class Seal:
    """The sums over the committed rows, and those with the block that is being written."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._sums = dict.fromkeys(TABLES, 0)
        self._staged = dict(self._sums)
        self.rows: Final = KnownRows(self._hash)

    def begin(self) -> None:
        """Forget what was staged and not committed."""
        self._staged = dict(self._sums)
        self.rows.begin()

    def keep(self) -> None:
        """What was staged is committed."""
        self._sums = self._staged
        self.rows.keep()

    def replace(self, table: str, old: Row | None, new: Row | None) -> None:
        """A row is written in the place of another one; None: there is none.

        Raises `TableCorruptedError` if the old row of the state is not this ledger's.
        """
        before, after = self._hash(table, old), self._hash(table, new)
        row = new or old
        if row is not None and table in _BY_KEY:
            namespace, key = row[:2]
            assert isinstance(namespace, str)
            assert isinstance(key, bytes)
            if table == "state":
                self.rows.stage_state((namespace, key), before, after)
            else:
                self.rows.stage_history((namespace, key), after)
        self._staged[table] = (self._staged[table] + after - before) % _MODULUS

    def value(self, number: int, header_hash: bytes) -> bytes:
        """What is stored after this block: its number and a tag for each table."""
        return number.to_bytes(_NUMBER_BYTES) + b"".join(self._tag(table, number, header_hash) for table in TABLES)

    def broken(self, stored: bytes, number: int, header_hash: bytes) -> list[str]:
        """The tables that are not as they were sealed after this block."""
        tags = [stored[at : at + _TAG_BYTES] for at in range(_NUMBER_BYTES, len(stored), _TAG_BYTES)]
        if len(tags) != len(TABLES) or sealed_number(stored) != number:
            return list(TABLES)
        return [
            table
            for table, tag in zip(TABLES, tags, strict=True)
            if not hmac.compare_digest(tag, self._tag(table, number, header_hash))
        ]

    def _tag(self, table: str, number: int, header_hash: bytes) -> bytes:
        total = self._staged[table].to_bytes(_TAG_BYTES)
        return hmac.digest(self._key, _encoded(("tag", table, number, header_hash, total)), "sha256")

    def _hash(self, table: str, row: Row | None) -> int:
        if row is None:
            return NO_ROW
        return int.from_bytes(hmac.digest(self._key, _encoded(("row", table, *row)), "sha256"))


def sealed_number(stored: bytes) -> int:
    """After which block a seal was made, by its own words."""
    return int.from_bytes(stored[:_NUMBER_BYTES])


def _encoded(values: Sequence[str | bytes | int | None]) -> bytes:
    """Each value with its type and length, so that no two rows are the same bytes."""
    parts: list[bytes] = []
    for value in values:
        if isinstance(value, bytes):
            parts += (b"b%d:" % len(value), value)
        elif isinstance(value, str):
            data = value.encode()
            parts += (b"s%d:" % len(data), data)
        elif value is None:
            parts.append(b"n:")
        else:
            parts.append(b"i%d:" % value)
    return b"".join(parts)
