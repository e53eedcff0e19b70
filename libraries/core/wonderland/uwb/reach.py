"""Which assurance a pad's nodes and a drone's can reach by what they say that they can do, and what stops them. Pure.

What a node can do is not all that a level needs: 3 and 4 need clocks that were commissioned, 4 a witness pad.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from wonderland_fira_uci.uci.capabilities import (
    Capabilities,
    DeviceRoles,
    MultiNodeModes,
    RangingMethods,
    RframeConfigs,
    ScheduleModes,
    StsConfigs,
)

CHANNEL: Final = 9
HIGHEST: Final = 4

Need = tuple[str, Callable[[Capabilities], bool | None]]
"""What is needed, in words, and whether a node has it; None where it does not say."""


@dataclass(frozen=True, slots=True)
class Missing:
    """From ``level`` on ``node`` lacks ``capability``; not ``told``: it does not say whether it has it."""

    level: int
    node: str
    capability: str
    told: bool

    def __str__(self) -> str:
        how = "cannot" if self.told else "does not say that it can"
        return f"assurance {self.level}: {self.node} {how} do {self.capability}"


@dataclass(frozen=True, slots=True)
class Reach:
    """``level``: the highest that nothing is missing for, 0 to 4. ``missing``: by level, what the others lack."""

    level: int
    missing: tuple[Missing, ...]


def _among(field: str, wanted: int, words: str) -> Need:
    """All bits of ``wanted`` in a mask."""

    def has(node: Capabilities) -> bool | None:
        mask: int | None = getattr(node, field)
        return None if mask is None else mask & wanted == wanted

    return words, has


def _keyed_frames(node: Capabilities) -> bool | None:
    """SP1 or SP3: frames with a scrambled sequence."""
    return None if node.rframe_configs is None else bool(node.rframe_configs & (RframeConfigs.SP1 | RframeConfigs.SP3))


def _role(role: DeviceRoles, words: str) -> Need:
    return _among("device_roles", role, words)


def _two_way(channel: int) -> tuple[Need, ...]:
    return (
        _among("ranging_methods", RangingMethods.DS_TWR_DEFERRED, "deferred DS-TWR"),
        _among("multi_node_modes", MultiNodeModes.ONE_TO_MANY, "one-to-many ranging"),
        _among("schedule_modes", ScheduleModes.TIME_SCHEDULED, "time-scheduled ranging"),
        ("frames SP1 or SP3", _keyed_frames),
        (f"channel {channel}", lambda node: None if node.channels is None else channel in node.channels),
    )


_RESPONDS: Final = _role(DeviceRoles.RESPONDER, "the role of a responder")
INITIATOR: Final = "the role of an initiator"
_INITIATES: Final = _role(DeviceRoles.INITIATOR, INITIATOR)
_KEYED: Final = _among("sts_configs", StsConfigs.PROVISIONED, "provisioned STS")
_STAMPS: Final = _among("ranging_methods", RangingMethods.UL_TDOA, "UL-TDoA")
_LOCKS: Final = _role(DeviceRoles.UT_ANCHOR, "the role of an UL-TDoA anchor")
_LEADS_CLOCKS: Final = _role(DeviceRoles.UT_SYNCHRONISATION_ANCHOR, "the role of an UL-TDoA synchronisation anchor")
_BLINKS: Final = _role(DeviceRoles.UT_TAG, "the role of an UL-TDoA tag")


def reach(
    pad: Mapping[str, Capabilities],
    drone: Capabilities | None = None,
    witness: Mapping[str, Capabilities] | None = None,
    *,
    channel: int = CHANNEL,
) -> Reach:
    """What the nodes of ``pad``, by name and the one that speaks first, can reach with a drone.

    Without ``drone`` or ``witness`` nothing is said of these: they are taken for able. ``level`` 4 without ``witness``
    means: with a witness pad whose nodes can do the same. Without nodes of a pad it is about the drone alone.
    """
    missing: list[Missing] = []
    for index, (name, node) in enumerate(pad.items()):
        speaks = index == 0
        roles = (_RESPONDS, _INITIATES) if speaks else (_RESPONDS,)
        missing += _lacks(name, node, 1, (*_two_way(channel), *roles))
        missing += _lacks(name, node, 2, (_KEYED,))
        missing += _lacks(name, node, 3, (_STAMPS, _LEADS_CLOCKS if speaks else _LOCKS))
    if drone is not None:
        missing += _lacks("the drone's node", drone, 1, (*_two_way(channel), _INITIATES, _RESPONDS))
        missing += _lacks("the drone's node", drone, 2, (_KEYED,))
        missing += _lacks("the drone's node", drone, 3, (_STAMPS, _BLINKS))
    for index, (name, node) in enumerate((witness or {}).items()):
        needs = (_KEYED, _STAMPS, _LOCKS if index else _LEADS_CLOCKS)
        missing += _lacks(f"{name} of the witness", node, HIGHEST, needs)
    missing.sort(key=lambda each: each.level)
    return Reach(missing[0].level - 1 if missing else HIGHEST, tuple(missing))


def _lacks(name: str, node: Capabilities, level: int, needs: tuple[Need, ...]) -> Iterator[Missing]:
    for words, has in needs:
        found = has(node)
        if not found:
            yield Missing(level, name, words, told=found is not None)
