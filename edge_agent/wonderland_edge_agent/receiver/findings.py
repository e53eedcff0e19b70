"""What is odd about a drone's broadcasts: findings, each with what was seen, none of them a verdict.

A finding is for people to look at and for the session that is under way; the contract judges positions by measurement,
never by these. Bounds are set so that an honest drone with an ordinary receiver, heard over several transports, causes
none; decision 0009 says why each has its value.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from msgspec.structs import replace

from wonderland import telemetry
from wonderland.telemetry import FindingKind

TWO_PLACES: Final = "two_places"
IMPOSSIBLE_SPEED: Final = "impossible_speed"
TIME_STUCK: Final = "time_stuck"
TIME_BACKWARDS: Final = "time_backwards"
TIME_OFF: Final = "time_off"
SEVERAL_IDENTITIES: Final = "several_identities"
RATE_HIGH: Final = "rate_high"
SIGNATURE_BAD: Final = "signature_bad"

EARTH_RADIUS_M: Final = 6_371_008.8
MAX_SPEED_M_S: Final = 150.0
"""Faster than any drone that lands on a pad."""
UNKNOWN_ACCURACY_M: Final = 30.0
SLACK_M: Final = 20.0
TWO_PLACES_M: Final = 100.0
TOGETHER_MS: Final = 5_000
"""Positions of two transmitters that are compared with each other."""
STUCK_MS: Final = 5_000
STUCK_COUNT: Final = 4
BACKWARDS_MS: Final = 1_000
OFF_MS: Final = 15_000
AGAIN_MS: Final = 60_000
MAX_REMEMBERED: Final = 1_024


@dataclass(frozen=True, slots=True)
class Finding:
    """One oddity of one drone, and when it was seen (Unix ms)."""

    t_ms: int
    body: telemetry.Finding


@dataclass(frozen=True, slots=True)
class Position:
    """A position as one transmitter broadcast it; ``claim_ms`` is its own time, ``t_ms`` that of its reception."""

    lat_e7: int
    lon_e7: int
    accuracy_mm: int | None
    t_ms: int
    claim_ms: int | None
    transport: str


def distance_m(one: Position, other: Position) -> float:
    """Along the ground on a sphere: half a percent off at worst, which no bound here notices."""
    lat1, lat2 = math.radians(one.lat_e7 / 1e7), math.radians(other.lat_e7 / 1e7)
    half_lat, half_lon = (lat2 - lat1) / 2, math.radians((other.lon_e7 - one.lon_e7) / 1e7) / 2
    chord = math.sin(half_lat) ** 2 + math.cos(lat1) * math.cos(lat2) * math.sin(half_lon) ** 2
    return 2 * EARTH_RADIUS_M * math.asin(min(1.0, math.sqrt(chord)))


def _tolerance_m(one: Position, other: Position) -> float:
    return sum(
        UNKNOWN_ACCURACY_M if position.accuracy_mm is None else position.accuracy_mm / 1000 for position in (one, other)
    )


def _between(kind: FindingKind, uav_id: str, new: Position, old: Position, away_m: float, interval_ms: int) -> Finding:
    return Finding(
        new.t_ms,
        telemetry.Finding(
            uav_id=uav_id,
            kind=kind,
            lat_e7=new.lat_e7,
            lon_e7=new.lon_e7,
            other_lat_e7=old.lat_e7,
            other_lon_e7=old.lon_e7,
            transport=new.transport,
            other_transport=old.transport,
            distance_mm=round(away_m * 1000),
            interval_ms=max(0, interval_ms),
        ),
    )


def two_places(uav_id: str, new: Position, old: Position) -> Finding | None:
    """Two transmitters with one identity, too far apart for the time between them."""
    interval_ms = abs(new.t_ms - old.t_ms)
    if interval_ms > TOGETHER_MS:
        return None
    away_m = distance_m(new, old)
    if away_m <= TWO_PLACES_M + _tolerance_m(new, old) + MAX_SPEED_M_S * interval_ms / 1000:
        return None
    return _between(TWO_PLACES, uav_id, new, old, away_m, interval_ms)


def impossible_speed(uav_id: str, new: Position, old: Position) -> Finding | None:
    """One transmitter that got further than anything flies."""
    if new.claim_ms is not None and old.claim_ms is not None and new.claim_ms > old.claim_ms:
        interval_ms = max(new.claim_ms - old.claim_ms, 100)
    else:
        interval_ms = max(new.t_ms - old.t_ms, 100)
    away_m = distance_m(new, old)
    if away_m <= SLACK_M + _tolerance_m(new, old) + MAX_SPEED_M_S * interval_ms / 1000:
        return None
    return _between(IMPOSSIBLE_SPEED, uav_id, new, old, away_m, interval_ms)


class ClaimClock:
    """The broadcast's own time, as one transmitter tells it: it has to go forward, and with ours."""

    __slots__ = ("_count", "_last_ms", "_since_ms")

    def __init__(self) -> None:
        self._last_ms: int | None = None
        self._since_ms = 0
        self._count = 0

    def compare_time(self, uav_id: str, new: Position) -> Finding | None:
        """What is odd about the time of a position."""
        if new.claim_ms is None:
            return None
        last_ms, interval_ms = self._last_ms, 0
        kind: FindingKind | None = None
        if last_ms is not None and new.claim_ms == last_ms:
            self._count += 1
            interval_ms = new.t_ms - self._since_ms
            if self._count >= STUCK_COUNT and interval_ms >= STUCK_MS:
                kind = TIME_STUCK
        else:
            if last_ms is not None and new.claim_ms < last_ms - BACKWARDS_MS:
                kind, interval_ms = TIME_BACKWARDS, last_ms - new.claim_ms
            self._last_ms, self._since_ms, self._count = new.claim_ms, new.t_ms, 1
        if kind is None and abs(new.t_ms - new.claim_ms) > OFF_MS:
            kind, interval_ms = TIME_OFF, abs(new.t_ms - new.claim_ms)
        if kind is None:
            return None
        return Finding(
            new.t_ms,
            telemetry.Finding(
                uav_id=uav_id,
                kind=kind,
                lat_e7=new.lat_e7,
                lon_e7=new.lon_e7,
                transport=new.transport,
                interval_ms=interval_ms,
            ),
        )


class FindingGate:
    """Tells a finding once and then once a minute while it lasts, with how often it was seen; bounded in memory."""

    def __init__(self) -> None:
        self._told: OrderedDict[tuple[str, str], tuple[int, int]] = OrderedDict()
        self._waiting: list[Finding] = []

    def put(self, finding: Finding | None) -> None:
        """Take what a check came to."""
        if finding is None:
            return
        key = finding.body.uav_id, finding.body.kind
        told_ms, unseen = self._told.get(key, (None, 0))
        if told_ms is not None and 0 <= finding.t_ms - told_ms < AGAIN_MS:
            self._told[key] = told_ms, unseen + 1
            return
        self._told[key] = finding.t_ms, 0
        self._told.move_to_end(key)
        if len(self._told) > MAX_REMEMBERED:
            self._told.popitem(last=False)
        if len(self._waiting) < MAX_REMEMBERED:
            self._waiting.append(Finding(finding.t_ms, replace(finding.body, count=finding.body.count + unseen)))

    def take_findings(self) -> list[Finding]:
        """What is to be told now."""
        waiting, self._waiting = self._waiting, []
        return waiting
