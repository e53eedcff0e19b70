"""What this ledger wrote, kept in memory: a row that somebody else put into the file is not believed when it is read.

For each key the keyed hash of its row of the state, and the sum of those of its history. They are taken when a start
reads all rows for the seal, and change with each block. A row that is changed, put in, taken away, exchanged or an
older one of the same key is another hash than the one kept, and stays one, however it is put back later.
All of it belongs to the event loop's thread; so a read sees either the rows before a block or those after it.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.embedded.errors import REMEDY, TableCorruptedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from wonderland_fabric_gateway.embedded.seal import Row

Place = tuple[str, bytes]
"""Namespace and key."""
NO_ROW: Final = 0
"""The hash of a row that is not there."""


class KnownRows:
    """The hashes of the committed rows of `state` and `history`, and those with the block that is being written."""

    def __init__(self, hash_of: Callable[[str, Row | None], int]) -> None:
        self.damage: TableCorruptedError | None = None
        self.on_damage: Callable[[TableCorruptedError], None] | None = None
        """Called with the first row that is not this ledger's."""
        self._hash_of = hash_of
        self._state: dict[Place, int] = {}
        self._history: dict[Place, int] = {}
        self._keys: dict[str, list[bytes]] = {}
        """The keys of the state by namespace, ascending: by them a row that is missing in a range is seen."""
        self._staged_state: dict[Place, int] = {}
        self._staged_history: dict[Place, int] = {}

    def begin(self) -> None:
        """Forget what was staged and not committed."""
        self._staged_state, self._staged_history = {}, {}

    def keep(self) -> None:
        """What was staged is committed."""
        for place, known in self._staged_state.items():
            self._keep_key(place, there=known != NO_ROW)
            if known == NO_ROW:
                self._state.pop(place, None)
            else:
                self._state[place] = known
        self._history.update(self._staged_history)
        self.begin()

    def stage_state(self, place: Place, before: int, after: int) -> None:
        """A row of the state is written over. Raises `TableCorruptedError` if the old one is not this ledger's."""
        if before != self._staged_state.get(place, self._state.get(place, NO_ROW)):
            raise self._damaged("state", place)
        self._staged_state[place] = after

    def stage_history(self, place: Place, added: int) -> None:
        """A row of the history is added."""
        self._staged_history[place] = self._staged_history.get(place, self._history.get(place, 0)) + added

    def require_sound(self) -> None:
        """Raise `TableCorruptedError` once a row was found that is not this ledger's."""
        if self.damage is not None:
            raise self.damage

    def check(self, place: Place, row: Row | None) -> None:
        """A row of the state as it was read, None: there is none. Raises `TableCorruptedError`."""
        self.require_sound()
        found, known = self._hash_of("state", row), self._state.get(place, NO_ROW)
        # While a block is being written durably, a read may see it already.
        if found not in (known, self._staged_state.get(place, known)):
            raise self._damaged("state", place)

    def checked_range(
        self, namespace: str, start: bytes, end: bytes, rows: Iterable[Any], *, end_included: bool = False
    ) -> Iterator[Any]:
        """The rows of a range, none wrong, more or missing up to the one last taken. Raises `TableCorruptedError`."""
        keys = self._keys.get(namespace, [])
        at = bisect_left(keys, start)
        for row in rows:
            key = row[1]
            assert isinstance(key, bytes)
            while at < len(keys) and keys[at] < key:
                self.check((namespace, keys[at]), None)
                at += 1
            self.check((namespace, key), row)
            at += at < len(keys) and keys[at] == key
            yield row
        while at < len(keys) and (not end or keys[at] < end or (end_included and keys[at] == end)):
            self.check((namespace, keys[at]), None)
            at += 1

    def check_history(self, place: Place, rows: Sequence[Row]) -> None:
        """All rows of a key's history as they were read. Raises `TableCorruptedError`."""
        self.require_sound()
        found = sum(self._hash_of("history", row) for row in rows)
        known = self._history.get(place, 0)
        if found not in (known, self._staged_history.get(place, known)):
            raise self._damaged("history", place)

    def _keep_key(self, place: Place, *, there: bool) -> None:
        if there == (place in self._state):
            return
        keys = self._keys.setdefault(place[0], [])
        at = bisect_left(keys, place[1])
        if there:
            keys.insert(at, place[1])
        else:
            del keys[at]

    def _damaged(self, table: str, place: Place) -> TableCorruptedError:
        key = f"namespace {place[0]}, key {place[1].decode(errors='backslashreplace')!r}"
        error = TableCorruptedError(
            f"table {table}, {key}: not what this ledger wrote; somebody changed ledger.sqlite3 while the ledger runs, "
            f"and it answers nothing from it any more. Find out who can write there, then start the ledger again: a "
            f"start checks every row. If it does not hold: {REMEDY}",
            table,
            key,
        )
        if self.damage is None:
            self.damage = error
            if self.on_damage is not None:
                self.on_damage(error)
        return error
