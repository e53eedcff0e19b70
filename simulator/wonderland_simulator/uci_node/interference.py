"""What foreign groups do to a round: frames of two groups on one channel and preamble code that overlap in time.

The nearer transmitter wins (capture): a frame survives where its sender is nearer to the receiver than any foreign
sender whose frame lies over it. Both ends of a pair lose the round with any of its frames. Groups that share a node are
not foreign: that node's one radio is what they have to share. A key keeps nobody from being drowned, only from being
believed.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator
from typing import Final, NamedTuple

from wonderland_fira_uci.uci.airtime import frame_us, slot_us
from wonderland_fira_uci.uci.config import AppConfig, RangingUsage

Reach = Callable[[str, str], int | None]
"""``reach(receiver, sender)``: mm between two nodes, by their names; None where one does not reach the other."""

_DATA_OCTETS: Final = 84
"""Frames are taken for as long as the longest, with data."""


class Frame(NamedTuple):
    """On the air from ``from_s`` to ``until_s``. ``responder``: which of the responders sends it; None: the leader."""

    sender: str
    from_s: float
    until_s: float
    responder: int | None


def frames_of(app: AppConfig, leader: str, responders: list[str], begun_s: float) -> list[Frame]:
    """The frames of a round by the leader's configuration: what ``least_slots`` counts."""
    slot_s, frame_s = slot_us(app.slot_duration_rstu) / 1e6, frame_us(app.rframe_config, _DATA_OCTETS) / 1e6
    order: list[int | None]
    if app.ranging_usage is RangingUsage.UL_TDOA:
        order = [None]
    else:
        control, reports = app.round_control >> 1 & 1, app.round_control & 1
        answers = list(range(len(responders)))
        order = [*[None] * (1 + control), *answers, None, None, *(answers if reports else [])]
    return [
        Frame(
            leader if index is None else responders[index],
            begun_s + slot * slot_s,
            begun_s + slot * slot_s + frame_s,
            index,
        )
        for slot, index in enumerate(order)
    ]


def pair_frames(frames: Iterable[Frame], responder: int) -> Iterator[Frame]:
    """Those that the leader and one responder need of a round."""
    return (frame for frame in frames if frame.responder in (None, responder))


def survives(frame: Frame, receiver: str, foreign: Iterable[Frame], reach: Reach | None, rng: random.Random) -> bool:
    """Whether ``receiver`` hears ``frame``. Without ``reach`` all are equally near, and a toss decides."""
    for other in foreign:
        if other.until_s <= frame.from_s or frame.until_s <= other.from_s:
            continue
        if reach is None:
            if rng.random() < 0.5:
                return False
            continue
        there_mm = reach(receiver, other.sender)
        here_mm = reach(receiver, frame.sender)
        if there_mm is not None and (here_mm is None or there_mm <= here_mm):
            return False
    return True
