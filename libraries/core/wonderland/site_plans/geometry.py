"""Rings in the plane: area, whether one crosses itself, whether one lies within another. Metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Point = tuple[float, float]
Ring = tuple[Point, ...]


def area(ring: Ring) -> float:
    """Area in square metres, positive where the ring runs anticlockwise."""
    return 0.5 * sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))


def _side(a: Point, b: Point, c: Point) -> int:
    """Of the line from a to b on which c lies: left 1, right −1, on it (within a micrometre) 0."""
    found = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    limit = 1e-6 * max(math.dist(a, b), 1e-6)
    return 0 if abs(found) <= limit else (1 if found > 0 else -1)


def _between(a: Point, b: Point, c: Point) -> bool:
    """Whether c, which is on their line, lies between a and b."""
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the edges ab and cd have a point in common."""
    sides = (_side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b))
    if sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0:
        return True
    touching = zip(sides, ((a, b, c), (a, b, d), (c, d, a), (c, d, b)), strict=True)
    return any(side == 0 and _between(*points) for side, points in touching)


def crossing(ring: Ring) -> tuple[int, int] | None:
    """Two edges of a closed ring that meet where they should not, by their numbers."""
    edges = list(pairwise(ring))
    # From west to east, so that an edge is compared only with those that begin before it ends.
    order = sorted(range(len(edges)), key=lambda each: min(edges[each][0][0], edges[each][1][0]))
    for place, one in enumerate(order):
        a, b = edges[one]
        east, south, north = max(a[0], b[0]), min(a[1], b[1]), max(a[1], b[1])
        for other in order[place + 1 :]:
            c, d = edges[other]
            if min(c[0], d[0]) > east:
                break
            if min(c[1], d[1]) <= north and max(c[1], d[1]) >= south and _wrong(edges, one, other):
                return min(one, other), max(one, other)
    return None


def _wrong(edges: Sequence[tuple[Point, Point]], one: int, other: int) -> bool:
    """Whether two edges of a ring meet, other than neighbours in the point that they share."""
    first, second = min(one, other), max(one, other)
    (a, b), (c, d) = edges[first], edges[second]
    if second == first + 1:
        return _folded(a, b, d)
    if first == 0 and second == len(edges) - 1:
        return _folded(b, a, c)
    return _meet(a, b, c, d)


def _folded(one: Point, shared: Point, other: Point) -> bool:
    """Whether two edges lie on one another."""
    ahead = (one[0] - shared[0]) * (other[0] - shared[0]) + (one[1] - shared[1]) * (other[1] - shared[1])
    return _side(one, shared, other) == 0 and ahead > 0


def within(ring: Ring, outer: Ring) -> bool:
    """Whether all points of a ring lie in another one, or on it."""
    return all(_inside(point, outer) for point in ring)


def _inside(point: Point, ring: Ring) -> bool:
    x, y = point
    inside = False
    for a, b in pairwise(ring):
        if _side(a, b, point) == 0 and _between(a, b, point):
            return True
        if (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]):
            inside = not inside
    return inside
