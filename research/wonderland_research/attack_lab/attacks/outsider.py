"""Attacks with a transmitter: somebody broadcasts a drone's serial number, or the drone tells the public lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records.sessions import BroadcastClaim
from wonderland_research.attack_lab.air import (
    EARLIEST_MS,
    LATEST_MS,
    Drone,
    OnAir,
    Outsider,
    Own,
    honest,
    play,
    said_by,
)
from wonderland_research.attack_lab.attacks.common import TWO_WAY
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import Floats, directions

ACCURACIES: Final = (None, 1_000, 3_000, 10_000, 20_000, 10_000_000)
TRANSMITTERS: Final = 50
FLOOD_PER_S: Final = 1_000
LIE_MM: Final = (6_000.0, 60_000.0)
"""Beyond what a message that states 1 m can mean, with twice that for an error of its own."""
DEAR_FLOOD: Final = 20


def _shift(rng: np.random.Generator, near: float, far: float) -> Floats:
    """A place ``near`` to ``far`` mm away; small and large distances alike."""
    return np.asarray(directions(rng, 1)[0] * np.exp(rng.uniform(np.log(near), np.log(far))))


def _accuracy(rng: np.random.Generator) -> int | None:
    return ACCURACIES[int(rng.integers(0, len(ACCURACIES)))]


def _transmitter(
    rng: np.random.Generator, drone: Drone, *, near: float, far: float, gap_ms: int, first_ms: int, last_ms: int
) -> list[BroadcastClaim]:
    """One that stays beside the drone's path, and states whatever accuracy it likes."""
    shift, accuracy = _shift(rng, near, far), _accuracy(rng)
    return [
        drone.message(t_ms, shift, heard_ms=t_ms, accuracy_mm=accuracy)
        for t_ms in range(first_ms + int(rng.integers(0, gap_ms)), last_ms, gap_ms)
    ]


def one(rng: np.random.Generator, drone: Drone, _air: OnAir) -> Sequence[BroadcastClaim]:
    """One transmitter: before the session, during all of it, or from its middle on."""
    first_ms = int(rng.choice((EARLIEST_MS, 0, 400, 900)))
    last_ms = int(rng.choice((400, 1_500, LATEST_MS)))
    return _transmitter(
        rng, drone, near=1_010.0, far=5e6, gap_ms=200, first_ms=first_ms, last_ms=max(last_ms, first_ms + 400)
    )


def many(rng: np.random.Generator, drone: Drone, _air: OnAir) -> Sequence[BroadcastClaim]:
    """Fifty transmitters about the drone."""
    return [
        message
        for _ in range(TRANSMITTERS)
        for message in _transmitter(
            rng, drone, near=1_010.0, far=1e5, gap_ms=500, first_ms=EARLIEST_MS, last_ms=LATEST_MS
        )
    ]


def repeated(rng: np.random.Generator, _drone: Drone, air: OnAir) -> Sequence[BroadcastClaim]:
    """The drone's own messages, each once more up to nine seconds later."""
    return [replace(each, t_ms=each.t_ms + int(rng.integers(100, 9_000))) for each in air.own for _ in range(3)]


def altered(rng: np.random.Generator, _drone: Drone, air: OnAir) -> Sequence[BroadcastClaim]:
    """The same with one field changed: another accuracy, another time, a place a little off, another height."""
    found = []
    for each in air.own:
        for _ in range(4):
            way = int(rng.integers(0, 4))
            change = (
                {"accuracy_mm": _accuracy(rng)},
                {"said_ms": (each.said_ms or 0) + 100 * int(rng.integers(-50, 50))},
                {"lat_e7": each.lat_e7 + int(rng.integers(-20_000, 20_000))},
                {"height_mm": int(rng.integers(-1_000_000, 50_000_000))},
            )[way]
            found.append(replace(each, t_ms=each.t_ms + int(rng.integers(0, 3_000)), **change))
    return found


def flood(rng: np.random.Generator, drone: Drone, _air: OnAir) -> Sequence[BroadcastClaim]:
    """A thousand messages a second: far away, hardly beyond the buffer, or as vague as one likes."""
    near, far = ((1_001.0, 2_000.0), (2_000.0, 60_000.0), (1e5, 5e6))[int(rng.integers(0, 3))]
    times = np.sort(rng.integers(EARLIEST_MS, LATEST_MS, FLOOD_PER_S * (LATEST_MS - EARLIEST_MS) // 1_000))
    accuracy = _accuracy(rng)
    return [
        drone.message(int(t_ms), _shift(rng, near, far), heard_ms=int(t_ms), accuracy_mm=accuracy) for t_ms in times
    ]


def vague(rng: np.random.Generator, drone: Drone, _air: OnAir) -> Sequence[BroadcastClaim]:
    """Just so far off that what they can mean is never settled: at the edge of their tolerance."""
    stated = int(rng.choice((600, 1_000, 3_000, 10_000, 20_000)))
    edge = max(1_000.0, 2.0 * stated)
    return [
        drone.message(t_ms, directions(rng, 1)[0] * edge * rng.uniform(0.97, 1.03), heard_ms=t_ms, accuracy_mm=stated)
        for t_ms in range(EARLIEST_MS, LATEST_MS, 100)
    ]


def only_lies(attests: bool, rng: np.random.Generator, drone: Drone) -> OnAir:
    """A drone that tells the public nothing but one lie."""
    shift = _shift(rng, *LIE_MM)
    return said_by(rng, drone, lambda _number: shift, attests=attests, stated_mm=1_000)


def lies_among_truths(attests: bool, rng: np.random.Generator, drone: Drone) -> OnAir:
    """Every other message is true. Where it attests at all, it attests them all."""
    shift = _shift(rng, *LIE_MM)
    return said_by(rng, drone, lambda number: shift * (number % 2), attests=attests, stated_mm=1_000)


def truths_unheard(rng: np.random.Generator, drone: Drone) -> OnAir:
    """It attests truths that it never sends, and sends lies."""
    truth = said_by(rng, drone, lambda _number: np.zeros(3), attests=True, stated_mm=1_000)
    return replace(only_lies(attests=False, rng=rng, drone=drone), attested=truth.attested)


def _played(own: Own, outsider: Outsider | None, dear: int = 4) -> tuple[Variant, ...]:
    return (Variant(TWO_WAY, play=partial(play, own, outsider, 2), dear=dear),)


_CONTROLS: Final = "What is on the air under the drone's serial number."
_WINS: Final = "An honest drone refuted, or refused although the pad hears its own broadcast."
_TRANSMITTER: Final = "A transmitter for a few euros."
_MODULE: Final = "A changed Remote ID module."

ATTACKS: Final = (
    Attack(
        "impostor",
        Family.OUTSIDER,
        "One transmitter broadcasts the serial number from elsewhere (1 m to 5 km), before, during or after",
        _CONTROLS,
        _TRANSMITTER,
        _WINS,
        "Only what the drone countersigned convicts it; a permission needs one heard broadcast that the measurement "
        "supports, and the pad goes on listening for it.",
        0,
        _played(honest, one),
        wire="impostor",
    ),
    Attack(
        "impostors",
        Family.OUTSIDER,
        "Fifty transmitters about the drone do",
        _CONTROLS,
        "Fifty transmitters.",
        _WINS,
        "As before: no number of contradicted messages weighs anything against one that holds.",
        0,
        _played(honest, many, DEAR_FLOOD),
    ),
    Attack(
        "broadcast-replay",
        Family.OUTSIDER,
        "The drone's own messages, attested or not, repeated up to nine seconds later",
        _CONTROLS,
        _TRANSMITTER,
        _WINS,
        "An attested message is judged at the time that it says itself.",
        0,
        _played(honest, repeated),
    ),
    Attack(
        "broadcast-altered",
        Family.OUTSIDER,
        "The same with one field changed: accuracy, time, place or height",
        _CONTROLS,
        _TRANSMITTER,
        _WINS,
        "The digest that the drone signs covers all that a message is judged by.",
        0,
        _played(honest, altered),
    ),
    Attack(
        "broadcast-flood",
        Family.OUTSIDER,
        "A thousand messages a second under the serial number",
        _CONTROLS,
        "A transmitter, or a way to the pad's receiver.",
        _WINS,
        "The pad keeps what was attested, what is nearest to the signed path, and the newest.",
        0,
        _played(honest, flood, DEAR_FLOOD),
    ),
    Attack(
        "broadcast-vague",
        Family.OUTSIDER,
        "Messages at the edge of what they can mean, which no number of rounds settles",
        _CONTROLS,
        _TRANSMITTER,
        _WINS,
        "What is not settled counts for nothing beside a broadcast that holds.",
        0,
        _played(honest, vague),
    ),
    Attack(
        "public-lie",
        Family.OUTSIDER,
        "A drone that tells the public one lie and attests nothing",
        "What the drone broadcasts.",
        _MODULE,
        "Any permission although the pad heard it lie meanwhile.",
        "Where somebody's broadcast is contradicted, a permission needs one that holds.",
        0,
        _played(partial(only_lies, False), None),
    ),
    Attack(
        "public-lie-attested",
        Family.OUTSIDER,
        "The same, countersigned",
        "What the drone broadcasts and signs.",
        _MODULE,
        "Any permission although the pad heard it lie meanwhile.",
        "It is refuted: it signed for the lie.",
        0,
        _played(partial(only_lies, True), None),
    ),
    Attack(
        "public-lies-among-truths",
        Family.OUTSIDER,
        "Every other message a lie, all of them countersigned",
        "What the drone broadcasts and signs.",
        _MODULE,
        "Any permission although the pad heard it lie meanwhile.",
        "Every message that was attested and heard has to hold.",
        0,
        _played(partial(lies_among_truths, True), None),
    ),
    Attack(
        "public-truths-unheard",
        Family.OUTSIDER,
        "It attests truths that it never sends, and sends lies",
        "What the drone broadcasts and signs.",
        _MODULE,
        "Any permission although the pad heard it lie meanwhile.",
        "What was not heard supports nothing.",
        0,
        _played(truths_unheard, None),
    ),
    Attack(
        "public-lies-unattested",
        Family.OUTSIDER,
        "Every other message a lie, and none countersigned",
        "What the drone broadcasts.",
        _MODULE,
        "Any permission although the pad heard it lie meanwhile.",
        "Nothing tells it from an honest drone beside an impostor: it is permitted where its place is proved, and the "
        "contradiction stands on the ledger and is an alert.",
        None,
        _played(partial(lies_among_truths, False), None),
    ),
)
