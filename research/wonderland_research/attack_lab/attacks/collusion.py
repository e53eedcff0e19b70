"""What no measurement can stop, measured all the same, so that nobody has to believe it."""

from __future__ import annotations

from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import (
    PAD_MEASURES,
    TWO_WAY,
    at_levels,
    lying,
    pad_at,
    ranges_of_claim,
    still,
)
from wonderland_research.attack_lab.batch import Batch
from wonderland_research.attack_lab.model import Attack, Family
from wonderland_research.attack_lab.places import witness_of


def accomplice(level: int, rng: np.random.Generator, count: int) -> Batch:
    """A second drone with the first one's keys stands at the claimed place; the first is anywhere."""
    pad = pad_at(level)
    place = np.rint(pad.places(rng, count))
    batch = still(rng, level, place, place, pad=pad)
    batch.won_mm = -1.0
    return batch


def many_transmitters(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Each anchor hears its own transmitter, and each of these keeps the time that fits the claim."""
    pad = pad_at(level)
    claim, truth = lying(rng, count, pad=pad)
    there = ranges_of_claim(pad, claim, truth)
    witness = ranges_of_claim(witness_of(pad), claim, truth)
    return still(rng, level, claim, truth, pad=pad, extra=there, frames=there, witness_frames=witness)


def pad_and_drone(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The pad invents ranges and time stamps, the drone's owner signs them; the witness is honest."""
    pad = pad_at(level)
    claim, truth = lying(rng, count, pad=pad)
    there = ranges_of_claim(pad, claim, truth)
    return still(rng, level, claim, truth, pad=pad, extra=there, frames=there)


ATTACKS: Final = (
    Attack(
        "borrowed-identity",
        Family.COLLUSION,
        "Two drones share keys: the one at the claimed place answers for the other",
        "The keys of a registered drone in a second drone, which is where the first one claims to be.",
        "A second drone.",
        "Any permission.",
        "No level: what is proved is that a holder of the keys is there. Keys in a secure element make it harder.",
        None,
        at_levels(accomplice, *TWO_WAY),
        wire="borrowed-identity",
    ),
    Attack(
        "pad-and-drone",
        Family.COLLUSION,
        "The pad's operator and the drone's owner invent a session together",
        "The keys of a pad and of a drone.",
        "A bribe.",
        "A permission more than one buffer from the claim.",
        "Level 4: the second pad's testimony is its own, signed by another agent. With that one too: nothing.",
        4,
        at_levels(pad_and_drone, *TWO_WAY),
    ),
    Attack(
        "transmitter-per-anchor",
        Family.COLLUSION,
        "A transmitter with the drone's keys beside each anchor, synchronised",
        "The drone's keys in as many radios as there are anchors, each beside one of them.",
        "Several radios, synchronised to a nanosecond, on the pad's site; at level 4 on the second pad's, too.",
        "A permission more than one buffer from the claim.",
        "No level: each anchor hears what its own transmitter wants it to.",
        None,
        at_levels(many_transmitters, *PAD_MEASURES),
    ),
)
