"""Where the anchors are: lists of them, and whether a pad can stand on them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from wonderland_edge_agent.commissioning.errors import SurveyError

MIN_ANCHORS: Final = 3
MAX_ANCHORS: Final = 16
COINCIDENT_M: Final = 0.05
LINE_M: Final = 0.10
"""As in the contract: anchors nearer to one line than this cannot tell its two sides apart."""
FURTHEST_M: Final = 200.0


def check_anchors(places: Mapping[str, Sequence[float]]) -> list[tuple[str, str]]:
    """(code, text) of what the operator should know about these places (m). Raises SurveyError for what cannot be."""
    names = list(places)
    if not MIN_ANCHORS <= len(names) <= MAX_ANCHORS:
        raise SurveyError(f"{len(names)} anchors; a pad has {MIN_ANCHORS} to {MAX_ANCHORS}")
    for index, name in enumerate(names):
        for other in names[:index]:
            if math.dist(places[name], places[other]) < COINCIDENT_M:
                raise SurveyError(
                    f"anchors {other} and {name} are surveyed at the same place; one of the two lines is wrong"
                )
    middle = [sum(places[name][axis] for name in names) / len(names) for axis in range(3)]
    for name in names:
        if math.dist(places[name], middle) > FURTHEST_M:
            raise SurveyError(
                f"anchor {name} is {math.dist(places[name], middle):.0f} m from the others; are its coordinates metres "
                "in the same frame?"
            )
    notes = []
    if _width(list(places.values())) < LINE_M:
        text = (
            "Seen from above all anchors lie on one line: each drone has a mirror image on its other side, nothing is "
            "verified, and the ledger refuses this pad. Set one anchor up beside the line."
        )
        notes.append(("anchors_on_a_line", text))
    if _height(list(places.values())) < LINE_M and len(names) > MIN_ANCHORS:
        text = (
            "All anchors are equally high: above and below look the same, and heights cannot be measured at all. Raise "
            "one anchor by a metre; assurance 3 needs that."
        )
        notes.append(("anchors_in_a_plane", text))
    return notes


def _width(points: Sequence[Sequence[float]]) -> float:
    """Distance of the furthest anchor from the line through the two furthest apart, seen from above (m)."""
    pairs = [(a, b) for index, a in enumerate(points) for b in points[:index]]
    a, b = max(pairs, key=lambda pair: math.dist(pair[0][:2], pair[1][:2]))
    length = math.dist(a[:2], b[:2])
    if length == 0.0:
        return 0.0
    return max(abs((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])) / length for p in points)


def _height(points: Sequence[Sequence[float]]) -> float:
    return max(p[2] for p in points) - min(p[2] for p in points)
