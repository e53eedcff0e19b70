"""What a pad says of itself, and when."""

from __future__ import annotations

import asyncio
import contextlib

from wonderland.telemetry import AnchorHealth, Health
from wonderland_edge_agent import health
from wonderland_edge_agent.health import tell_health


def word(state, prekeys=20):
    return Health(anchors=(AnchorHealth(anchor_id="A1", state=state),), prekeys=prekeys)


class Backend:
    def __init__(self):
        self.heard = []

    def offer(self, _t_ms, told):
        self.heard.append(told)


async def heard_after(backend, words, monkeypatch, seconds=0.2):
    """What the backend has heard, where the pad is like each of the words for one look, and stays like the last."""
    monkeypatch.setattr(health, "LOOK_S", 0.01)
    left = list(words)
    telling = asyncio.create_task(
        tell_health(lambda: {"t_ms": 1}, lambda: left.pop(0) if len(left) > 1 else left[0], backend, ())
    )
    await asyncio.sleep(seconds)
    telling.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await telling
    return backend.heard


async def test_an_anchor_that_goes_down_is_told_at_once(monkeypatch):
    heard = await heard_after(Backend(), [word("up"), word("up"), word("down")], monkeypatch)
    assert [each.anchors[0].state for each in heard] == ["up", "down"]


async def test_the_first_keys_that_are_offered_are_told_at_once_and_not_each_that_is_used(monkeypatch):
    states = [word("up", None), word("up", None), word("up", 20), word("up", 20), word("up", 19), word("up", 18)]
    heard = await heard_after(Backend(), states, monkeypatch)
    assert [each.prekeys for each in heard] == [None, 20]
