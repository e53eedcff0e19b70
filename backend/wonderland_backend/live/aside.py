"""What a backend that follows must know beside the frames that clients see."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Aside:
    """Of one frame; empty for most of them."""

    pads: dict[str, str] = field(default_factory=dict)
    """Whose a pad is on the ledger now (MSP id): who may see it."""
    drones: dict[str, str] = field(default_factory=dict)
    gone: list[str] = field(default_factory=list)
    """Sessions that are shown no longer, since newer ones are."""
    people: dict[str, int] = field(default_factory=dict)
    """Sign-ins whose live connections end, and with which code."""
    committed: bool = False
    """The mirror has committed a block: there may be events."""
    organisations: bool = False
    """The channel's organisations have changed."""

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to be told."""
        return self == _NOTHING


_NOTHING = Aside()
