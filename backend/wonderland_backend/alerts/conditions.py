"""What is wrong now: the common form in which the watch is told of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wonderland_backend.alerts.kinds import Alert


@dataclass(frozen=True)
class Condition:
    """Something that is wrong now. `key` tells two of one kind apart, and stays the same while it lasts."""

    kind: str
    key: str
    t_ms: int
    pad_id: str | None
    facts: dict[str, Any]
    uav_id: str | None = None

    def alert(self, now_ms: int) -> Alert:
        """The alert that it raises; another time it would be another one."""
        return Alert(
            self.kind, f"{self.key}@{now_ms}", self.t_ms, pad_id=self.pad_id, uav_id=self.uav_id, facts=self.facts
        )
