"""Closures of a pad: when zones forbid it what, worked out by the authority and written out as plain spans of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.fields import ACTIONS, Name, PadId, TimeMs
from wonderland.proofs.records.schema import Choice, Items, Record, Text

MAX_CLOSURES: Final = 400
"""Two weeks of a dozen zones that close a pad twice a day; about 40 kB."""
ZONE_ID_PATTERN: Final = r"[A-Z]{3}:[A-Za-z0-9][A-Za-z0-9 ._+-]{0,6}"
ZoneId = Annotated[str, Text(11, ZONE_ID_PATTERN, "Zone: ISO 3166-1 alpha-3 country and identifier (ED-318)")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Closure(Record):
    """One span of time in which a zone forbids some actions at a pad."""

    zone_id: ZoneId
    actions: Annotated[tuple[str, ...], Items(1, 3, of=Choice(ACTIONS))]
    from_ms: TimeMs
    until_ms: TimeMs

    def validate(self, path: str) -> None:
        """The span must not be empty."""
        if self.until_ms <= self.from_ms:
            raise RecordError(f"{path}.until_ms" if path else "until_ms", "must be after from_ms")

    def forbids(self, action: str, from_ms: int, until_ms: int) -> bool:
        """Whether it forbids this action at any time of the span."""
        return action in self.actions and self.from_ms < until_ms and from_ms < self.until_ms


@dataclass(frozen=True, kw_only=True, slots=True)
class Closures(Record):
    """All closures of a pad until a time; after that time nobody knows, and nothing is permitted there."""

    pad_id: PadId
    closures: Annotated[tuple[Closure, ...], Items(0, MAX_CLOSURES)]
    valid_until_ms: TimeMs
    set_by: Name
    set_ms: TimeMs
