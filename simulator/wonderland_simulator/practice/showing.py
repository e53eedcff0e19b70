"""How far a scenario is: a table that changes on a terminal, lines elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from wonderland_simulator.flight import Vector
from wonderland_simulator.pads_air import node_name
from wonderland_simulator.practice.reading import Scenario
from wonderland_simulator.practice.world import PracticeWorld
from wonderland_simulator.uci_node import PtyPort, VirtualNode


def what_to_enter(scenario: Scenario) -> Iterator[str]:
    """Ports and addresses, as they go into pad.toml and uav.toml."""
    for pad in scenario.pads:
        yield f"Pad {pad.told.pad_id} ({pad.told.node}), for its pad.toml:"
        for anchor_id, port in pad.ports.items():
            yield f"  [[anchors]] anchor_id = {anchor_id}, port = {port}"
        if pad.reports is not None:
            yield f"  [uwb] kind = dwm1001-tags, listen = {pad.reports[0]}:{pad.reports[1]}"
        yield f"  [remote_id] listen = {pad.remote_id[0]}:{pad.remote_id[1]}"
    for each in scenario.vehicles:
        yield f"Vehicle {each.told.uav_id} ({each.node}) at {each.told.pad}, for its uav.toml:"
        yield f"  port = {each.port}"
        if each.board is not None:
            yield f"  node = dwm1001-anchor, board = {each.board:04x}, report_to = its pad's uwb.listen"
        if each.position is not None:
            yield f"  position = {each.position_option}"
        if each.told.autopilot is not None:
            yield "  its autopilot looks for a ground station at {}:{}".format(*each.told.autopilot.ground_station)


def state_of(port: PtyPort) -> str:
    """How a node is, in a word."""
    if not port.is_plugged:
        return "unplugged"
    if port.hangs:
        return "hangs"
    if not isinstance(port.node, VirtualNode):
        return "is there"
    if port.node.sessions:
        return "ranges"
    return "in use" if port.node.is_in_use else "waits"


def table(world: PracticeWorld, said: list[str]) -> RenderableType:
    """Everything as it is now, and what was said last."""
    vehicles = Table("Vehicle", "Node", "Way", "Is at (E, N, U m)", "Claims (E, N, U m)", "Off", expand=True)
    for uav_id, tour in world.tours.items():
        claimed = tour.claimed_m
        off = "" if claimed is None else f"{math.dist(claimed, tour.flight.position):.2f} m"
        vehicles.add_row(
            uav_id,
            state_of(world.ports[uav_id]),
            tour.doing,
            _place(tour.flight.position),
            "" if claimed is None else _place(claimed),
            off,
        )
    pads = Table("Pad", "Nodes", expand=True)
    for pad in world.scenario.pads:
        states = [
            f"{anchor_id} {state_of(world.ports[node_name(pad.told.pad_id, anchor_id)])}" for anchor_id in pad.ports
        ]
        pads.add_row(pad.told.pad_id, " · ".join(states))
    fault = world.to_come
    ahead = "" if fault is None else f", next: {fault.node} {fault.what} at {fault.at_s:g} s"
    return Group(vehicles, pads, Text("\n".join(said)), Text(f"{world.now_s:.0f} s{ahead}. Ctrl-C ends it.", "dim"))


def _place(place: Vector) -> str:
    return ", ".join(f"{each:.1f}" for each in place)
