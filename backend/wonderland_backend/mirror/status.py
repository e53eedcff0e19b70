"""How far the mirror is, as the mirror itself keeps it up to date."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Final

from wonderland_backend.context import part

_SHOWN: Final = (
    "height", "mirrored", "connected", "halted", "halted_since_ms", "problem", "organisations", "alone_since_ms",
    "rows_checked_ms",
)  # fmt: skip


@dataclass
class MirrorStatus:
    """The mirror's state for everyone to read; only the mirror writes it."""

    kind: str = "unknown"
    notice: str = ""
    channel: str = ""
    height: int = 0
    mirrored: int = 0
    connected: bool = False
    halted: str | None = None
    halted_since_ms: int | None = None
    problem: str | None = None
    organisations: list[str] = field(default_factory=list)
    level_ms: int | None = None
    """When the mirror was last seen level with the ledger; None when never."""
    alone_since_ms: int | None = None
    """Since when no other organisation's peer says that it has the same; None while one does, or there is none."""
    rows_checked_ms: int | None = None
    """When all rows were last compared with the ledger; None before the first time."""
    rows_checked_height: int = 0
    rows_differ: tuple[str, ...] = ()
    """Rows that were not what the ledger says: table, key, and what about them."""
    transactions: int = 0
    """Mirrored since the start, for metrics."""
    unread: int = 0
    """Writes since the start that could not be read, for metrics."""

    def show(self, ledger: dict[str, Any], now_ms: int) -> None:
        """What the backend on duty says of its mirror (`to_json`)."""
        for name in _SHOWN:
            setattr(self, name, ledger.get(name))
        self.rows_differ = tuple(ledger["rows_differ"])
        self.level_ms = now_ms - ledger["lag_ms"]

    def begin(self, now_ms: int) -> None:
        """Nothing is known yet of this backend's own mirror."""
        self.show(MirrorStatus(self.kind, self.notice, self.channel).to_json(now_ms), now_ms)

    @property
    def is_level(self) -> bool:
        """Whether everything that the ledger is known to have is here."""
        return self.connected and self.halted is None and self.mirrored >= self.height

    def saw(self, height: int, now_ms: int) -> None:
        """The ledger has so many blocks."""
        if self.is_level or self.level_ms is None:
            self.level_ms = now_ms
        self.height = max(self.height, height)

    def lost(self, now_ms: int, problem: str) -> None:
        """The ledger, or the database, cannot be reached just now."""
        if self.is_level or self.level_ms is None:
            self.level_ms = now_ms
        self.connected = False
        self.problem = problem

    def halt(self, now_ms: int, why: str) -> None:
        """Until somebody looks."""
        self.saw(self.height, now_ms)
        self.halted, self.halted_since_ms = why, now_ms

    def lag_ms(self, now_ms: int) -> int:
        """For how long the mirror has not been level with the ledger."""
        if self.is_level:
            return 0
        return max(0, now_ms - self.level_ms) if self.level_ms is not None else 0

    def to_json(self, now_ms: int) -> dict[str, Any]:
        """As the status shows it."""
        shown: dict[str, Any] = {
            "kind": self.kind,
            "notice": self.notice,
            "channel": self.channel,
            "height": self.height,
            "mirrored": self.mirrored,
            "lag_ms": self.lag_ms(now_ms),
            "connected": self.connected,
            "halted": self.halted,
            "organisations": self.organisations,
            "alone_since_ms": self.alone_since_ms,
            "rows_checked_ms": self.rows_checked_ms,
            "rows_differ": list(self.rows_differ),
        }
        if self.halted_since_ms is not None:
            shown["halted_since_ms"] = self.halted_since_ms
        if self.problem is not None:
            shown["problem"] = self.problem
        return shown


MirrorStatusDep = Annotated[MirrorStatus, part(MirrorStatus)]
