"""What somebody who does not see everything gets of the live frames: the same frames, less what is not theirs.

Frames keep their numbers, so that resuming works alike; a frame of which nothing is left still tells its number.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, Final

import orjson

from wonderland_backend.masking import without_names
from wonderland_backend.person import Person, Scope

_ITEMS: Final = ("pads", "tracks", "estimates", "sessions", "verdicts", "alerts")
Owner = Callable[[str], str | None]
"""Pad or drone → whose it is on the ledger (MSP id)."""


class Lens:
    """One way to see the frames; people with the same rights share it."""

    def __init__(self, scope: Scope, *, names: bool, pad_owner: Owner, drone_owner: Owner) -> None:
        self._scope = scope
        self._names = names
        self._pad_owner = pad_owner
        self._drone_owner = drone_owner
        self.key: Final = repr((scope, names))

    @classmethod
    def of(cls, person: Person, *, pad_owner: Owner, drone_owner: Owner) -> Lens | None:
        """The person's lens; None for the authority, who sees the frames as they are."""
        if person.has("admin", "inspector"):
            return None
        names = person.has("pad_operator", "fleet_operator")
        return cls(person.scope, names=names, pad_owner=pad_owner, drone_owner=drone_owner)

    def epoch(self, epoch: str) -> str:
        """Whoever sees something else than before must not resume: its epoch is another one."""
        return hashlib.sha256(f"{epoch} {self.key}".encode()).hexdigest()[:16]

    def frame(self, text: str) -> str:
        """A delta, or a part of a snapshot, as seen through this lens."""
        frame: dict[str, Any] = orjson.loads(text)
        for kind in _ITEMS:
            if kind in frame:
                theirs = [item for item in frame[kind] if self._is_theirs(item)]
                if kind == "alerts" and not self._names:
                    theirs = [without_names(item) for item in theirs]
                frame[kind] = theirs
                if not theirs and frame["type"] == "delta":
                    del frame[kind]
        if not self._scope.everything and "status" in frame:
            # How much there is of everything is not theirs to know.
            frame["status"].pop("counts", None)
        return orjson.dumps(frame).decode()

    def _is_theirs(self, item: dict[str, Any]) -> bool:
        scope = self._scope
        if scope.everything:
            return True
        pad_id, uav_id = item.get("pad_id"), item.get("uav_id")
        if scope.pads_of and pad_id is not None and self._pad_owner(pad_id) == scope.pads_of:
            return True
        return bool(scope.drones_of) and uav_id is not None and self._drone_owner(uav_id) == scope.drones_of
