"""The radio plan that a pad and a drone follow: a pure function of what both sides' nodes can do and of the session.

Both compute it from the ledger, so that no word about it has to go over the air.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, cast

from wonderland.proofs.keys import SessionKeys
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.radios import NodeAbility
from wonderland.uwb.blinks import BlinkPlan, blink_plan
from wonderland.uwb.layout import RangingPlan, WordWays
from wonderland.uwb.regions import BY_CODE
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS
from wonderland_fira_uci.uci.capabilities import Capabilities, DeviceRoles, RangingMethods, StsConfigs

ASSUMED: Final = NodeAbility(
    words="both_ways", word_octets=84, slot_us=2_000, channels=(5, 9), sts="provisioned", blinks="scheduled"
)
"""Of nodes that nobody asked: what FiRa wants of all, and of the optional what published stacks have."""
PREFERRED_CHANNEL: Final = 9
PREAMBLE_CODES_OF_ALL: Final = (9, 10, 11, 12)
"""Of the base pulse rate, on every channel. Sessions within reach of each other seldom draw the same one: a receiver
hears frames of its own code only, and the drone that waits for its turn at a pad disturbs nobody then."""
TIMED: Final = 3
"""The assurance from which on the pad's own time stamps are needed."""
_UPLINK: Final = DeviceRoles.UT_SYNCHRONISATION_ANCHOR | DeviceRoles.UT_ANCHOR | DeviceRoles.UT_TAG


def weakest(abilities: Sequence[NodeAbility]) -> NodeAbility:
    """What all of these can do (at least one). Raises RangingPlanError where they have no channel in common."""
    channels = set.intersection(*({*each.channels} for each in abilities))
    if not channels:
        raise RangingPlanError(f"no channel that all nodes have: {', '.join(str(each.channels) for each in abilities)}")
    return NodeAbility(
        words="both_ways" if all(each.words == "both_ways" for each in abilities) else "initiator",
        word_octets=min(each.word_octets for each in abilities),
        slot_us=max(each.slot_us for each in abilities),
        channels=tuple(sorted(channels)),
        sts="provisioned" if all(each.sts == "provisioned" for each in abilities) else "static",
        blinks="scheduled" if all(each.blinks == "scheduled" for each in abilities) else "none",
    )


def ability_of(
    capabilities: Capabilities | None, words: WordWays = "both_ways", region: str | None = None
) -> NodeAbility | None:
    """What a node can do, by what it says; None where it says nothing.

    No node says who carries data in a ranging session: its operator knows. Channels are those of ``region`` alone.
    Raises RangingPlanError where none is left.
    """
    if capabilities is None:
        return None
    channels = ASSUMED.channels if capabilities.channels is None else capabilities.channels
    if region is not None:
        channels = tuple(channel for channel in channels if channel in BY_CODE[region].channels)
    if not channels:
        raise RangingPlanError(f"the node has none of the channels that may be used{f' in {region}' if region else ''}")
    methods, roles, sts = capabilities.ranging_methods, capabilities.device_roles, capabilities.sts_configs
    blinks = methods is not None and roles is not None and RangingMethods.UL_TDOA in methods and roles & _UPLINK
    slot_us = 0 if capabilities.min_slot_rstu is None else -(-capabilities.min_slot_rstu * 1_000 // RSTU_PER_MS)
    return NodeAbility(
        words=words,
        word_octets=ASSUMED.word_octets,
        slot_us=max(slot_us, ASSUMED.slot_us),
        channels=channels,
        sts="provisioned" if sts is None or StsConfigs.PROVISIONED in sts else "static",
        blinks="scheduled" if blinks else "none",
    )


def preamble_code_of(session_a_id: int) -> int:
    """What a session draws by its id. Ids of ranging sessions are even: their last bit tells them from the words'."""
    return PREAMBLE_CODES_OF_ALL[session_a_id // 2 % len(PREAMBLE_CODES_OF_ALL)]


def out_of_reach(commissioning: Commissioning, node: NodeAbility | None, policy: Policy) -> str:
    """Why no proof at this pad by this drone can have the assurance that a policy demands; empty where one can."""
    for side, ability in (("the pad's nodes", commissioning.nodes), ("the drone's node", node)):
        lacks = (
            (2, ability is not None and ability.sts != "provisioned", "provisioned STS"),
            (3, ability is not None and ability.blinks != "scheduled", "blinks (UL-TDoA)"),
        )
        for level, missing, what in lacks:
            if missing and policy.min_assurance >= level:
                return f"the policy demands assurance {policy.min_assurance}, and {side} cannot do {what}"
    if policy.min_assurance >= TIMED and commissioning.timestamp_sigma_mm is None:
        return f"the policy demands assurance {policy.min_assurance}, and the pad's nodes share no clock"
    return ""


def no_plan(commissioning: Commissioning, node: NodeAbility | None) -> str:
    """Why a pad's nodes and a drone's cannot range each other; empty where they can."""
    pad, uav = commissioning.nodes or ASSUMED, node or ASSUMED
    for side, ability in (("the pad's nodes", pad), ("the drone's node", uav)):
        if ability.sts != "provisioned":
            return f"{side} cannot do provisioned STS, without which ranges prove nothing"
    if not {*pad.channels} & {*uav.channels}:
        return f"the pad's nodes have channels {pad.channels}, the drone's node {uav.channels}"
    return ""


def agreed_plan(
    keys: SessionKeys,
    commissioning: Commissioning,
    node: NodeAbility | None,
    witness_blinks: BlinkPlan | None = None,
) -> RangingPlan:
    """The plan of a session with a drone's ``node``. Raises RangingPlanError naming what stands in the way, where."""
    problem = no_plan(commissioning, node)
    if problem:
        raise RangingPlanError(problem)
    uav = node or ASSUMED
    both = weakest((commissioning.nodes or ASSUMED, uav))
    return RangingPlan(
        session_a_id=keys.session_a,
        session_b_id=keys.session_b,
        pad_macs=tuple(anchor.mac for anchor in commissioning.anchors),
        uav_mac=keys.uav_mac,
        sts_key=keys.sts_key,
        channel=PREFERRED_CHANNEL if PREFERRED_CHANNEL in both.channels else both.channels[0],
        preamble_code=preamble_code_of(keys.session_a),
        words=cast("WordWays", both.words),
        word_octets=both.word_octets,
        slot_duration_rstu=-(-both.slot_us * RSTU_PER_MS // 1_000),
        blinks=blink_plan(keys, commissioning) if both.blinks == "scheduled" else None,
        witness_blinks=witness_blinks if uav.blinks == "scheduled" else None,
    )
