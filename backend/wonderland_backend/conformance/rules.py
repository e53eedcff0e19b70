"""The rules, without I/O.

A proof says where the drone was when it was measured. Before and after, the drone can have moved, and no faster than
some speed. So a proof at time t with the drone within `e` of the place M bounds how far the drone is from a position
that it broadcasts for the time t + Δ:

    at most   |B − M| + e + v·|Δ|          (`within_mm`)
    at least  |B − M| − e − v·|Δ|          (`beyond_mm`, less what the broadcast itself allows for)

The broadcast is *supported* where the first is small enough for whoever asks, and *contradicted* where the second is
above zero: then the drone cannot be where it says, however it flew. Anything else is *unproven*: the proof is about
another place or another time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

Status = Literal["supported", "contradicted", "unproven", "unknown"]
Limit = Literal[
    "not_registered",
    "never_heard",
    "broadcast_stale",
    "no_proof",
    "no_measured_place",
    "assurance_too_low",
    "too_far_or_too_long_ago",
    "last_proof_refuted",
    "last_proof_inconclusive",
    "broadcast_refuted",
    "broadcast_unattributed",
    "speed_impossible",
]

EARTH_MM: Final = 6_371_008_771
"""Mean radius. On a sphere distances are up to 0.6 % off, which is added to the doubt."""
SPHERE_PERMILLE: Final = 6
E7_RAD: Final = math.pi / 180 / 10_000_000
CONFIDENCE_99: Final = 9.21
"""χ² with two degrees of freedom, 99 %."""
STALE_MS: Final = 60_000
"""ASTM F3411's near-real-time window: what is older is no present broadcast."""
OWN_LIE: Final = frozenset({"own_contradicted", "refuted"})
"""Broadcasts that the drone signed for; "refuted" in verdicts of former contracts."""
SAME_STAY_MS: Final = 120_000
"""So long after a verdict about the broadcast itself, a broadcast of the same place is taken for the same lie."""


@dataclass(frozen=True, slots=True)
class Broadcast:
    """A position that a drone told the public."""

    lat_e7: int
    lon_e7: int
    t_ms: int
    accuracy_mm: int = 0
    """Its own word on its horizontal accuracy, 95 %; 0 where it gives none."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What a proof says."""

    t_ms: int
    outcome: str
    assurance: int
    broadcast_outcome: str | None
    place: tuple[int, int] | None
    """lat_e7, lon_e7 of the measured place."""
    ee_mm2: int = 0
    en_mm2: int = 0
    nn_mm2: int = 0

    @property
    def radius_mm(self) -> int:
        """Of the circle that holds the drone with 99 %: around the covariance's longer axis."""
        half_sum = (self.ee_mm2 + self.nn_mm2) / 2
        half_difference = (self.ee_mm2 - self.nn_mm2) / 2
        longest = half_sum + math.hypot(half_difference, self.en_mm2)
        return math.ceil(math.sqrt(CONFIDENCE_99 * max(0.0, longest)))


@dataclass(frozen=True, slots=True)
class Question:
    """What whoever asks takes for supported."""

    within_mm: int
    max_speed_mm_s: int
    min_assurance: int


@dataclass(frozen=True, slots=True)
class Finding:
    """The answer, and what it rests on. Distances are None where there is nothing to measure them from."""

    status: Status
    limits: tuple[Limit, ...]
    distance_mm: int | None = None
    within_mm: int | None = None
    beyond_mm: int | None = None
    age_ms: int | None = None
    supported_until_ms: int | None = None


def judge(broadcast: Broadcast | None, proof: Measured | None, question: Question, now_ms: int) -> Finding:
    """What a proof says about a broadcast of a drone that is known."""
    limits: list[Limit] = []
    if proof is not None and proof.broadcast_outcome == "contradicted":
        limits.append("broadcast_unattributed")
    if broadcast is None:
        limits.append("never_heard")
    elif now_ms - broadcast.t_ms > STALE_MS:
        limits.append("broadcast_stale")
    if proof is None:
        return Finding("unproven", (*limits, "no_proof"))
    if proof.outcome == "refuted":
        limits.append("last_proof_refuted")
    elif proof.outcome == "inconclusive":
        limits.append("last_proof_inconclusive")
    if proof.assurance < question.min_assurance:
        limits.append("assurance_too_low")
    if proof.place is None:
        limits.append("no_measured_place")
    if broadcast is None or proof.place is None:
        return Finding("unproven", tuple(limits))
    return _compared(broadcast, proof, proof.place, question, limits)


def _compared(
    broadcast: Broadcast, proof: Measured, place: tuple[int, int], question: Question, limits: list[Limit]
) -> Finding:
    age_ms = broadcast.t_ms - proof.t_ms
    apart_mm = distance_mm((broadcast.lat_e7, broadcast.lon_e7), place)
    doubt_mm = proof.radius_mm + math.ceil(question.max_speed_mm_s * abs(age_ms) / 1000)
    doubt_mm += apart_mm * SPHERE_PERMILLE // 1000
    within_mm = apart_mm + doubt_mm
    beyond_mm = max(0, apart_mm - doubt_mm - broadcast.accuracy_mm)
    trusted = proof.assurance >= question.min_assurance and proof.outcome != "inconclusive"
    left_ms = (question.within_mm - apart_mm - proof.radius_mm) * 1000 // question.max_speed_mm_s
    facts = {"distance_mm": apart_mm, "within_mm": within_mm, "beyond_mm": beyond_mm, "age_ms": age_ms}
    if trusted and beyond_mm > 0:
        return Finding("contradicted", (*limits, "speed_impossible"), **facts)
    if trusted and proof.broadcast_outcome in OWN_LIE and abs(age_ms) <= SAME_STAY_MS:
        return Finding("contradicted", (*limits, "broadcast_refuted"), **facts)
    near = within_mm <= question.within_mm
    if trusted and near and proof.outcome == "verified" and "broadcast_stale" not in limits:
        return Finding("supported", tuple(limits), **facts, supported_until_ms=proof.t_ms + left_ms)
    if not near:
        limits.append("too_far_or_too_long_ago")
    return Finding("unproven", tuple(limits), **facts)


def distance_mm(one: tuple[int, int], other: tuple[int, int]) -> int:
    """Along the sphere between two places (lat_e7, lon_e7)."""
    lat_a, lon_a, lat_b, lon_b = (value * E7_RAD for value in (*one, *other))
    chord = math.sin((lat_b - lat_a) / 2) ** 2 + math.cos(lat_a) * math.cos(lat_b) * math.sin((lon_b - lon_a) / 2) ** 2
    return round(2 * EARTH_MM * math.asin(min(1.0, math.sqrt(chord))))
