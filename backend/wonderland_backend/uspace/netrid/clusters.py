"""What a display may show of flights in a view: near, each by itself; from further away, areas that hold some.

The areas are cells of the one grid that does not move (`geo`), so that panning and zooming narrows nothing down. By
the standard (NET0480, NET0490) an area is at least 15 % of the view and reaches 300 m to each side of what it hides: a
flight can be at a cell's edge, and so every cell is shown with 300 m more around it, whoever is in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from uas_standards.astm.f3411.v22a import constants

from wonderland_backend.uspace.flights import Flight
from wonderland_backend.uspace.geo import TILES, Box, Cell
from wonderland_backend.uspace.netrid.views import MAX_DETAILS_DIAGONAL_M

LEAST_SHARE: Final = constants.NetMinClusterSizePercent / 100


@dataclass(frozen=True, slots=True)
class Cluster:
    """An area with so many flights."""

    box: Box
    flights: int


def shows_each(view: Box) -> bool:
    """Whether a view is small enough to show flights by themselves, with their details."""
    return bool(view.diagonal_m() <= MAX_DETAILS_DIAGONAL_M)


def clusters_of(flights: Iterable[Flight], view: Box) -> list[Cluster]:
    """The areas that flights are in, by where each was last."""
    least_m2 = view.area_m2() * LEAST_SHARE
    found = Counter(_cell(flight, least_m2) for flight in flights)
    return [
        Cluster(cell.box().grown(constants.NetMinObfuscationDistanceM), count) for cell, count in sorted(found.items())
    ]


def _cell(flight: Flight, least_m2: float) -> Cell:
    """The finest cell around a flight that is large enough."""
    state = flight.current
    for level in range(TILES):
        cell = Cell.at(state.lat, state.lng, level)
        if cell.box().area_m2() >= least_m2:
            return cell
    return Cell.at(state.lat, state.lng, TILES)
