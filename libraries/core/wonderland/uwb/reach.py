"""Which assurance a pad's nodes and a drone's can reach by what they say that they can do, and what stops them. Pure.

What a node can do is not all that a level needs: 3 and 4 need clocks that were commissioned, 4 a witness pad.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from wonderland.uwb.layout import WordWays
from wonderland.uwb.needs import KEYED, RANGES, Need, Part, blink_needs, channel_among, lacking, needs_of
from wonderland_fira_uci.uci.capabilities import Capabilities

HIGHEST: Final = 4


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


def reach(
    pad: Mapping[str, Capabilities],
    drone: Capabilities | None = None,
    witness: Mapping[str, Capabilities] | None = None,
    *,
    channel: int | None = None,
    words: WordWays = "both_ways",
    region: str | None = None,
) -> Reach:
    """What the nodes of ``pad``, by name and the one that speaks first, can reach with a drone.

    Without ``drone`` or ``witness`` nothing is said of these: they are taken for able. ``level`` 4 without ``witness``
    means: with a witness pad whose nodes can do the same. Without nodes of a pad it is about the drone alone. ``words``
    as in ``RangingPlan``; ``channel``: that of the plan, None for any that all have, of ``region`` where it is given.
    """
    missing: list[Missing] = []
    taking_part = dict(pad) | ({} if drone is None else {"the drone's node": drone})
    for index, (name, node) in enumerate(taking_part.items()):
        part: Part = "drone" if node is drone and name not in pad else "answers" if index else "speaks"
        missing += _lacks(name, node, needs_of(part, words, channel))
    channels = {name: node.channels for name, node in taking_part.items()}
    if (
        channel is None
        and all(channels.values())
        and taking_part
        and channel_among(*channels.values(), region=region) is None
    ):
        said = ", ".join(f"{name} has {' '.join(map(str, each or ()))}" for name, each in channels.items())
        shared = f"a channel of region {region}" if len(channels) == 1 else "a channel that all have"
        place = f" and that region {region} has" if region and len(channels) > 1 else ""
        missing.append(Missing(RANGES, ", ".join(channels), f"{shared}{place} ({said})", told=True))
    for index, (name, node) in enumerate((witness or {}).items()):
        part = "answers" if index else "speaks"
        needs = (*(each for each in needs_of(part, words) if each.level == KEYED), *blink_needs(part))
        missing += _lacks(f"{name} of the witness", node, needs, least=HIGHEST)
    missing.sort(key=lambda each: each.level)
    return Reach(missing[0].level - 1 if missing else HIGHEST, tuple(missing))


def _lacks(name: str, node: Capabilities, needs: Iterable[Need], *, least: int = RANGES) -> Iterator[Missing]:
    for need, told in lacking(node, needs):
        yield Missing(max(need.level, least), name, need.words, told=told)
