"""What a pad's nodes can do, asked for a commissioning that needs them for nothing else: one from a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wonderland.clock import SteadyClock
from wonderland_edge_agent.commissioning.alone import alone
from wonderland_edge_agent.commissioning.errors import RadioError
from wonderland_edge_agent.commissioning.live.radios import open_nodes, recorded_ability
from wonderland_edge_agent.radios import AnchorPort

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland.proofs.records.radios import NodeAbility
    from wonderland_edge_agent.settings import AnchorSetting, PadSettings
    from wonderland_fira_uci.uci.capabilities import Capabilities

UNTOLD: Final = (
    "What the pad's nodes can do is not on the record ({}). Sessions take them for what published stacks can: slots of "
    "2 ms, channels 5 and 9, blinks. Where they can do less, plug them in, stop the agent, and publish again."
)


@dataclass(frozen=True, slots=True)
class Told:
    """``nodes``: what the weakest can do, None where none said it. ``note``: what people should know of it, if any."""

    nodes: NodeAbility | None
    note: str


async def ask_nodes(pad: PadSettings, anchor_ids: Sequence[str]) -> Told:
    """Ask the nodes that pad.toml names, in the record's order of anchors.

    Raises RadioError where one that answers can take part in no session.
    """
    if pad.uwb.kind != "uci":
        return Told(None, "")  # these boards say nothing of themselves, and their words go by UDP
    absent = [anchor.anchor_id for anchor in pad.anchors if not _there(anchor)]
    if absent:
        return Told(None, UNTOLD.format(f"no port for {', '.join(absent)}"))
    try:
        said = await _said(pad, anchor_ids)
    except RadioError as error:
        return Told(None, UNTOLD.format(error))
    nodes = recorded_ability(pad, said)
    if nodes is None:
        return Told(None, UNTOLD.format("none of them says it"))
    silent = ", ".join(name for name, capabilities in said.items() if capabilities is None)
    return Told(
        nodes, f"What the nodes of {silent} can do was not said; the record is of the others." if silent else ""
    )


async def _said(pad: PadSettings, anchor_ids: Sequence[str]) -> dict[str, Capabilities | None]:
    """What each says that it can do, by anchor; RadioError where an agent holds them, or too few answer."""
    with alone(pad.spool):
        async with open_nodes([AnchorPort.of(anchor) for anchor in pad.anchors], SteadyClock()) as nodes:
            return {name: nodes[name].capabilities for name in anchor_ids}


def _there(anchor: AnchorSetting) -> bool:
    return "://" in anchor.port or Path(anchor.port).exists()
