"""From live frames to the single things that are told outside. Pure."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from wonderland_backend.settings.outputs import Kind

_LISTS: Final[tuple[tuple[str, Kind], ...]] = (("tracks", "claim"), ("estimates", "estimate"), ("verdicts", "verdict"))
_PERSONAL: Final = frozenset({"operator_id"})
"""Whose drone it is stays with those who may see it in the console."""
_REMEMBERED: Final = 20_000


@dataclass(frozen=True, slots=True)
class Item:
    """One thing that is known of a drone. `body` has the names and units of the REST interface."""

    kind: Kind
    uav_id: str
    t_ms: int
    body: dict[str, Any]

    @property
    def verified(self) -> bool:
        """Whether the ledger says that the drone is where it says: never so of a refutation."""
        return self.kind == "verdict" and self.body["outcome"] == "verified"

    def to_json(self) -> dict[str, Any]:
        """The item as one object, which says what it is."""
        return {"kind": self.kind, "verified": self.verified, **self.body}


def items_of(frame: dict[str, Any]) -> Iterator[Item]:
    """The items of a live frame, verdicts last, so that each follows the positions that it is about."""
    for name, kind in _LISTS:
        for body in frame.get(name, ()):
            open_to_all = {field: value for field, value in body.items() if field not in _PERSONAL}
            yield Item(kind, body["uav_id"], body["decided_ms" if kind == "verdict" else "t_ms"], open_to_all)


class Gate:
    """Lets through what an output asked for: positions of a drone at their own pace, every verdict once."""

    def __init__(self, kinds: frozenset[Kind], period_ms: int) -> None:
        self._kinds = kinds
        self._period_ms = period_ms
        self._told: OrderedDict[tuple[Kind, str], int] = OrderedDict()
        self._decided = (-1, -1)

    def lets_through(self, item: Item) -> bool:
        """Whether the item is to be told."""
        if item.kind not in self._kinds:
            return False
        if item.kind == "verdict":
            return _place(item) > self._decided  # a snapshot begins with verdicts that were told before
        last_ms = self._told.get((item.kind, item.uav_id))
        return last_ms is None or not last_ms <= item.t_ms < last_ms + self._period_ms

    def note_told(self, item: Item) -> None:
        """The item went out; until this is said it counts as not told."""
        if item.kind == "verdict":
            self._decided = max(self._decided, _place(item))
            return
        key = (item.kind, item.uav_id)
        self._told[key] = item.t_ms
        self._told.move_to_end(key)
        if len(self._told) > _REMEMBERED:
            self._told.popitem(last=False)


def _place(item: Item) -> tuple[int, int]:
    return item.body["block"], item.body["tx_index"]
