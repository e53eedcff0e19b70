"""Which pads the ledger tells other closures of than the imported zones do.

Looking costs geometry; so a pad is looked at again only when its record, its closures or the data sets have changed,
and every ten minutes, for zones that begin and end by the clock.
"""

from __future__ import annotations

from typing import Final

from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import ClosuresRow, PadRow
from wonderland_backend.errors import Unprocessable
from wonderland_backend.zones import pads, queries

AGAIN_MS: Final = 10 * 60_000
SETTLE_MS: Final = 60_000
"""Whoever has imported zones is about to publish what follows from them."""
WRONG: Final = frozenset({"missing", "differs"})
Seen = tuple[object, ...]


class Differing:
    """Remembers what it found for each pad, and of what."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Seen, str]] = {}

    async def look_at_pads(self, database: AsyncSession, now_ms: int) -> list[tuple[str, str]]:
        """Pads, and how theirs are wrong: `missing` or `differs`."""
        sets = await queries.imports_that_hold(database)
        if any(now_ms - imported_ms < SETTLE_MS for _, imported_ms in sets):
            return self._wrong()
        data = (tuple(import_id for import_id, _ in sets), now_ms // AGAIN_MS)
        known: dict[str, tuple[Seen, str]] = {}
        for pad, published in await queries.pads_with_closures(database):
            place = None if published is None else (published.block, published.tx_index)
            seen: Seen = (*data, pad.block, pad.tx_index, place)
            before = self._known.get(pad.pad_id)
            if before is not None and before[0] == seen:
                known[pad.pad_id] = before
            else:
                known[pad.pad_id] = (seen, await _state(database, pad, published, now_ms))
        self._known = known
        return self._wrong()

    def _wrong(self) -> list[tuple[str, str]]:
        return [(pad_id, state) for pad_id, (_, state) in self._known.items() if state in WRONG]


async def _state(database: AsyncSession, pad: PadRow, published: ClosuresRow | None, now_ms: int) -> str:
    try:
        return pads.state_of(await pads.zones_of(database, pad, published), now_ms)
    except Unprocessable:
        return "differs"  # More closures than a record holds: what is published cannot be all of them.
