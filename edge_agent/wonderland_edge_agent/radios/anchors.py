"""What hangs on a pad's ports, and how each anchor's node is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from wonderland.clock import Clock
from wonderland.telemetry.fields import AnchorCondition
from wonderland_edge_agent.session.events import PadEvent
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.serial_port import Opener
from wonderland_fira_uci.uci.capabilities import Capabilities

if TYPE_CHECKING:
    from wonderland_edge_agent.settings import AnchorSetting

MIN_ANCHORS: Final = 3
"""A horizontal position needs three ranges."""
READY_GRACE_S: Final = 0.5
"""A node that is away when a session begins gets this long to come back."""

Sink = Callable[[PadEvent], None]


class RadiosError(Exception):
    """The pad's nodes cannot range now; the text says which and why."""


@dataclass(frozen=True, slots=True)
class AnchorPort:
    """Which anchor hangs on which serial port."""

    anchor_id: str
    port: str | Opener
    settings: tuple[tuple[bytes, bytes], ...] = ()
    """Parameters of the node's maker (antenna delay, power), given after each reset."""

    @classmethod
    def of(cls, anchor: AnchorSetting) -> Self:
        """As pad.toml has it."""
        return cls(anchor.anchor_id, anchor.opener(), anchor.settings())

    def node(self, clock: Clock) -> UwbNode:
        """The node there, not connected yet."""
        return UwbNode(self.port, name=f"anchor {self.anchor_id}", clock=clock, settings=self.settings)


@dataclass(frozen=True, slots=True)
class AnchorState:
    """One anchor's node, for people. ``state``: up, down (port or node away), or silent (answers, and does not range).

    ``detail``: why it is not up.
    """

    anchor_id: str
    state: AnchorCondition
    detail: str
    firmware: str | None
    capabilities: Capabilities | None = None
    """What the node says that it can do; None where it has not said."""
    faulty: bool = False
    """It is silent while others range: no drone out of reach explains that."""
    unproven: bool = False
    """Nothing has shown yet whether it ranges: no other anchor hears it, and no drone has come."""
    speaks: bool = True
    """Whether its node accepts data, as far as anybody knows."""
    unseen: bool = False
    """Nobody has looked yet whether it ranges, since the start or since its node came back."""

    @property
    def ranges(self) -> bool:
        """Whether it would measure a drone in reach, as far as anybody knows."""
        return self.state != "down" and not self.faulty


def firmware_of(node: UwbNode) -> str | None:
    """For people; None where the node has not said it."""
    info = node.info
    return None if info is None else f"UCI {_version(info.uci_version)}, PHY {_version(info.phy_version)}"


def _version(value: int) -> str:
    """Major in the low octet, minor in the upper half of the high one, patch in the lower."""
    return f"{value & 0xFF}.{value >> 12}.{value >> 8 & 0xF}"
