"""The classes of attack that the lab knows; each module is one family."""

from __future__ import annotations

from typing import Final

from wonderland_research.attack_lab.attacks import (
    baseline,
    calibration,
    claim,
    collusion,
    height,
    insider,
    mirrors,
    moments,
    motion,
    outsider,
    pad,
    position,
    protocol,
    radio,
)
from wonderland_research.attack_lab.model import Attack

ATTACKS: Final[dict[str, Attack]] = {
    attack.name: attack
    for family in (
        baseline,
        calibration,
        position,
        claim,
        height,
        moments,
        mirrors,
        motion,
        outsider,
        radio,
        insider,
        pad,
        protocol,
        collusion,
    )
    for attack in family.ATTACKS
}
