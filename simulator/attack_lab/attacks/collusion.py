"""What no measurement can stop, measured all the same, so that nobody has to believe it."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from simulator.attack_lab.attacks.common import TWO_WAY, lying, ranges_of_claim, still
from simulator.attack_lab.batch import Batch
from simulator.attack_lab.model import Attack, Family, Variant
from simulator.attack_lab.places import SQUARE


def accomplice(level: int, rng: np.random.Generator, count: int) -> Batch:
    """A second drone with the first one's keys stands at the claimed place; the first is anywhere."""
    place = np.rint(SQUARE.places(rng, count))
    batch = still(rng, level, place, place)
    batch.won_mm = -1.0
    return batch


def many_transmitters(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Each anchor hears its own transmitter, and each of these keeps the time that fits the claim."""
    claim, truth = lying(rng, count)
    return still(rng, level, claim, truth, extra=ranges_of_claim(SQUARE, claim, truth))


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
        (Variant(TWO_WAY, make=partial(accomplice, 2)),),
    ),
    Attack(
        "transmitter-per-anchor",
        Family.COLLUSION,
        "A transmitter with the drone's keys beside each anchor, synchronised",
        "The drone's keys in as many radios as there are anchors, each beside one of them.",
        "Several radios, synchronised to a nanosecond, on the pad's site.",
        "A permission more than one buffer from the claim.",
        "No level: each anchor hears what its own transmitter wants it to.",
        None,
        (Variant((1, 2), make=partial(many_transmitters, 2)),),
    ),
)
