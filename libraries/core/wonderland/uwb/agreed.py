"""The radio plan that a pad and a drone follow: a pure function of what both sides' nodes can do and of the session.

Both compute it from the ledger, so that no word about it has to go over the air.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, cast

from wonderland.proofs.keys import SessionKeys, derive
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.radios import NodeAbility
from wonderland.uwb.blinks import BlinkPlan, blink_plan
from wonderland.uwb.layout import RangingPlan, WordWays
from wonderland.uwb.needs import (
    KEYED,
    RANGES,
    TIMED,
    Part,
    channel_among,
    in_region,
    lacking,
    needs_of,
    slot_us,
    word_octets,
)
from wonderland.uwb.regions import BY_CODE
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS
from wonderland_fira_uci.uci.capabilities import Capabilities, StsConfigs

ASSUMED: Final = NodeAbility(
    words="both_ways", word_octets=84, slot_us=2_000, channels=(5, 9), sts="provisioned", blinks="scheduled"
)
"""Of nodes that nobody asked: what FiRa wants of all, and of the optional what published stacks have."""
PREAMBLE_CODES_OF_ALL: Final = (9, 10, 11, 12)
"""Of the base pulse rate, on every channel. Sessions within reach of each other seldom draw the same one: a receiver
hears frames of its own code only, and the drone that waits for its turn at a pad disturbs nobody then."""


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
    capabilities: Capabilities | None,
    words: WordWays = "both_ways",
    region: str | None = None,
    *,
    part: Part = "drone",
    who: str = "the drone's node",
) -> NodeAbility | None:
    """What a node can do for its ``part`` in a session, by what it says; None where it says nothing.

    No node says who carries data in a ranging session: its operator knows. Channels are those of ``region`` alone.
    Raises RangingPlanError naming what ``who`` lacks, where no plan can do without.
    """
    if capabilities is None:
        return None
    said_no = [need for need, told in lacking(capabilities, needs_of(part, words)) if told]
    for need in said_no:
        if need.level == RANGES:
            raise RangingPlanError(f"{who} cannot do {need.words}{_how(need.words, capabilities)}")
    channels = in_region(ASSUMED.channels if capabilities.channels is None else capabilities.channels, region)
    if not channels:
        raise RangingPlanError(f"{who} has none of the channels that may be used in {region}")
    blinks = not any(need.level == TIMED for need, _ in lacking(capabilities, needs_of(part, words)))
    keyed = capabilities.sts_configs is None or StsConfigs.PROVISIONED in capabilities.sts_configs
    octets = word_octets(capabilities)
    return NodeAbility(
        words=words,
        word_octets=ASSUMED.word_octets if octets is None else min(octets, ASSUMED.word_octets),
        slot_us=max(slot_us(capabilities), ASSUMED.slot_us),
        channels=channels,
        sts="provisioned" if keyed else "static",
        blinks="scheduled" if blinks else "none",
    )


def pad_ability(
    nodes: Mapping[str, Capabilities | None], words: WordWays = "both_ways", region: str | None = None
) -> NodeAbility | None:
    """What the weakest of a pad's nodes can do, by anchor and the one that speaks first; None where none says it.

    Raises RangingPlanError naming the anchor that lacks what no plan can do without, or the region.
    """
    told = []
    for index, (anchor_id, said) in enumerate(nodes.items()):
        part: Part = "answers" if index else "speaks"
        found = ability_of(said, words, region, part=part, who=f"the node of anchor {anchor_id}")
        if found is not None:
            told.append(found)
    return weakest(told) if told else None


def _how(words: str, said: Capabilities) -> str:
    """The number behind a lack that is one."""
    if words.startswith("slots"):
        return f": its shortest slot takes {slot_us(said) / 1_000:.1f} ms"
    if words.startswith("data"):
        return f": it takes {word_octets(said)} at a time"
    return ""


def preamble_code_of(session_a_id: int) -> int:
    """What a session draws by its id. Ids of ranging sessions are even: their last bit tells them from the words'."""
    return PREAMBLE_CODES_OF_ALL[session_a_id // 2 % len(PREAMBLE_CODES_OF_ALL)]


def out_of_reach(commissioning: Commissioning, node: NodeAbility | None, policy: Policy) -> str:
    """Why no proof at this pad by this drone can have the assurance that a policy demands; empty where one can."""
    sides = (("the pad's nodes", commissioning.nodes), ("the drone's node", node))
    unable = {
        (KEYED, "provisioned STS"): [side for side, it in sides if it is not None and it.sts != "provisioned"],
        (TIMED, "blinks (UL-TDoA)"): [side for side, it in sides if it is not None and it.blinks != "scheduled"],
    }
    for (level, what), who in unable.items():
        if who and policy.min_assurance >= level:
            unknown = "" if commissioning.nodes else "; what the pad's nodes can do is not in its commissioning"
            all_of_them = " and ".join(who)
            return f"the policy demands assurance {policy.min_assurance}, and {all_of_them} cannot do {what}{unknown}"
    if policy.min_assurance >= TIMED and commissioning.timestamp_sigma_mm is None:
        return f"the policy demands assurance {policy.min_assurance}, and the pad's nodes share no clock"
    return ""


def no_plan(commissioning: Commissioning, node: NodeAbility | None, region: str | None = None) -> str:
    """Why a pad's nodes and a drone's cannot range each other, in ``region`` where it is given; empty where they can.

    What refuses a session's plan refuses it here: it is the same function, with keys that nobody uses.
    """
    macs = {anchor.mac for anchor in commissioning.anchors}
    own = next(mac for mac in range(1, len(macs) + 2) if mac not in macs)
    try:
        plan = agreed_plan(replace(derive(bytes(32), bytes(32)), uav_mac=own), commissioning, node)
    except RangingPlanError as error:
        return str(error)
    return outside(plan.channel, region)


def outside(channel: int, region: str | None) -> str:
    """Why a channel may not be used in a region; empty where it may, or where none is set."""
    if in_region((channel,), region):
        return ""
    channels = ", ".join(map(str, BY_CODE[region or ""].channels))
    return f"the plan has channel {channel}, and region {region} has channels {channels} alone (pad.toml, uwb.region)"


def witness_plan(
    keys: SessionKeys, commissioning: Commissioning, node: NodeAbility | None, payload: bytes = b""
) -> BlinkPlan | None:
    """The blinks that a witness hears; None where its nodes share no clock, or no channel with the drone's ``node``."""
    plan, channel = blink_plan(keys, commissioning, payload), _channel(commissioning, node)
    return None if plan is None or channel is None else replace(plan, channel=channel)


def agreed_plan(
    keys: SessionKeys,
    commissioning: Commissioning,
    node: NodeAbility | None,
    witness_blinks: BlinkPlan | None = None,
) -> RangingPlan:
    """The plan of a session with a drone's ``node``. Raises RangingPlanError naming what stands in the way, where."""
    pad, uav = commissioning.nodes or ASSUMED, node or ASSUMED
    for side, ability in (("the pad's nodes", pad), ("the drone's node", uav)):
        if ability.sts != "provisioned":
            raise RangingPlanError(f"{side} cannot do provisioned STS, without which ranges prove nothing")
    channel = _channel(commissioning, node)
    if channel is None:
        raise RangingPlanError(f"the pad's nodes have channels {pad.channels}, the drone's node {uav.channels}")
    both = weakest((pad, uav))
    blinks = blink_plan(keys, commissioning) if both.blinks == "scheduled" else None
    return RangingPlan(
        session_a_id=keys.session_a,
        session_b_id=keys.session_b,
        pad_macs=tuple(anchor.mac for anchor in commissioning.anchors),
        uav_mac=keys.uav_mac,
        sts_key=keys.sts_key,
        channel=channel,
        preamble_code=preamble_code_of(keys.session_a),
        words=cast("WordWays", both.words),
        word_octets=both.word_octets,
        slot_duration_rstu=-(-both.slot_us * RSTU_PER_MS // 1_000),
        blinks=None if blinks is None else replace(blinks, channel=channel),
        witness_blinks=witness_blinks if uav.blinks == "scheduled" else None,
    )


def _channel(commissioning: Commissioning, node: NodeAbility | None) -> int | None:
    return channel_among((commissioning.nodes or ASSUMED).channels, (node or ASSUMED).channels)
