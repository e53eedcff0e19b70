"""What a session's plan wants of each node: one list, for plans, their refusals and ``wonderland uwb capabilities``.

Pure. What a node does not say is neither there nor missing: who asks decides what to make of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from wonderland.uwb.layout import CHANNELS, WordWays
from wonderland.uwb.regions import BY_CODE
from wonderland_fira_uci.uci.airtime import RSTU_PER_MS
from wonderland_fira_uci.uci.capabilities import (
    Capabilities,
    DeviceRoles,
    DeviceTypes,
    MultiNodeModes,
    RangingMethods,
    RframeConfigs,
    ScheduleModes,
    StsConfigs,
)
from wonderland_fira_uci.uci.data import SEND_HEADER_OCTETS

Part = Literal["drone", "speaks", "answers"]
"""The drone's node; the pad's that speaks to it, its first; each of the pad's others."""
PREFERRED_CHANNEL: Final = 9
MIN_WORD_OCTETS: Final = 48
"""Of data in a frame: less than this leaves nothing for words beside their headers and tags."""
MAX_SLOT_US: Final = 20_000
RANGES, KEYED, TIMED = 1, 2, 3
"""Assurance from which on something is needed. 1 and 2 are needed by every plan: it has no other way to range."""
_ROLE_WORDS: Final = {
    DeviceRoles.RESPONDER: "the role of a responder",
    DeviceRoles.INITIATOR: "the role of an initiator",
    DeviceRoles.UT_ANCHOR: "the role of an UL-TDoA anchor",
    DeviceRoles.UT_SYNCHRONISATION_ANCHOR: "the role of an UL-TDoA synchronisation anchor",
    DeviceRoles.UT_TAG: "the role of an UL-TDoA tag",
}
_BLINK_ROLES: Final[dict[Part, DeviceRoles]] = {
    "drone": DeviceRoles.UT_TAG,
    "speaks": DeviceRoles.UT_SYNCHRONISATION_ANCHOR,
    "answers": DeviceRoles.UT_ANCHOR,
}


@dataclass(frozen=True, slots=True)
class Need:
    """``level``: the assurance from which on it is needed. ``has``: whether a node has it; None: it does not say."""

    level: int
    words: str
    has: Callable[[Capabilities], bool | None]


def needs_of(part: Part, words: WordWays = "both_ways", channel: int | None = None) -> tuple[Need, ...]:
    """What a node needs for its part in a session's plan, where data goes these ways; ``channel``: None for any."""
    leads, follows = part == "drone", part != "drone"
    if words == "initiator":  # the pad's words go in a session that its own node leads
        leads, follows = leads or part == "speaks", True
    return (
        _bits(RANGES, "ranging_methods", RangingMethods.DS_TWR_DEFERRED, "deferred DS-TWR"),
        _bits(RANGES, "multi_node_modes", MultiNodeModes.ONE_TO_MANY, "one-to-many ranging"),
        _bits(RANGES, "schedule_modes", ScheduleModes.TIME_SCHEDULED, "time-scheduled ranging"),
        _bits(RANGES, "rframe_configs", RframeConfigs.SP1, "frames SP1"),
        Need(RANGES, "preamble codes of the base pulse rate", _base_rate),
        Need(RANGES, "a channel of high-rate UWB", _any_channel) if channel is None else _on(channel),
        Need(RANGES, f"slots of {MAX_SLOT_US / 1_000:.0f} ms", _keeps_slots),
        Need(RANGES, f"data of {MIN_WORD_OCTETS} octets in a frame", _carries_words),
        *((_role(RANGES, DeviceRoles.INITIATOR), _type(DeviceTypes.CONTROLLER, "a controller")) if leads else ()),
        *((_role(RANGES, DeviceRoles.RESPONDER), _type(DeviceTypes.CONTROLEE, "a controlee")) if follows else ()),
        _bits(KEYED, "sts_configs", StsConfigs.PROVISIONED, "provisioned STS"),
        *blink_needs(part),
    )


def blink_needs(part: Part) -> tuple[Need, ...]:
    """What it needs to blink, or to time-stamp blinks."""
    return _bits(TIMED, "ranging_methods", RangingMethods.UL_TDOA, "UL-TDoA"), _role(TIMED, _BLINK_ROLES[part])


def lacking(node: Capabilities, needs: Iterable[Need]) -> Iterator[tuple[Need, bool]]:
    """What a node does not have, and whether it said so."""
    for need in needs:
        found = need.has(node)
        if not found:
            yield need, found is not None


def slot_us(node: Capabilities) -> int:
    """The node's shortest slot; 0 where it does not say."""
    return 0 if node.min_slot_rstu is None else -(-node.min_slot_rstu * 1_000 // RSTU_PER_MS)


def in_region(channels: Iterable[int], region: str | None) -> tuple[int, ...]:
    """Those of the channels that ``region`` has; all of them where it is None."""
    return tuple(each for each in channels if region is None or each in BY_CODE[region].channels)


def channel_among(*channels: Sequence[int] | None, region: str | None = None) -> int | None:
    """The channel that nodes use who have these; None where they share none that ``region`` has.

    None among ``channels``: of a node that does not say.
    """
    told = [{*each} for each in channels if each is not None]
    shared = in_region(sorted(set.intersection(*told)) if told else CHANNELS, region)
    if PREFERRED_CHANNEL in shared:
        return PREFERRED_CHANNEL
    return shared[0] if shared else None


def _bits(level: int, field: str, wanted: int, words: str) -> Need:
    """All bits of ``wanted`` in a mask."""

    def has(node: Capabilities) -> bool | None:
        mask: int | None = getattr(node, field)
        return None if mask is None else mask & wanted == wanted

    return Need(level, words, has)


def _role(level: int, role: DeviceRoles) -> Need:
    return _bits(level, "device_roles", role, _ROLE_WORDS[role])


def _type(wanted: DeviceTypes, words: str) -> Need:
    """UCI 1 does not say it: a node that names no types is none that lacks one."""
    return Need(
        RANGES, f"the part of {words}", lambda node: node.device_types is None or bool(node.device_types & wanted)
    )


def _base_rate(node: Capabilities) -> bool | None:
    """A parameter set at the base pulse rate; without a word about any it has what all have to have."""
    return node.bprf_sets is None or bool(node.bprf_sets)


def _on(channel: int) -> Need:
    return Need(RANGES, f"channel {channel}", lambda node: None if node.channels is None else channel in node.channels)


def _any_channel(node: Capabilities) -> bool | None:
    return None if node.channels is None else bool(node.channels)


def _keeps_slots(node: Capabilities) -> bool:
    return slot_us(node) <= MAX_SLOT_US


def word_octets(node: Capabilities) -> int | None:
    """The most data that the node takes at a time; None where it does not say.

    One word is one packet of UCI: longer ones would have to be cut up on the way to the node.
    """
    message = None if node.max_message_octets is None else node.max_message_octets - SEND_HEADER_OCTETS
    said = [each for each in (node.max_data_payload_octets, message) if each is not None]
    return min(said, default=None)


def _carries_words(node: Capabilities) -> bool:
    said = word_octets(node)
    return said is None or said >= MIN_WORD_OCTETS
