"""The shell that pad and drone share: it waits without spinning, and leaves nothing running behind."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

import pytest

from wonderland.session.actions import Finish
from wonderland.session.events import Tick
from wonderland.session.runner import SessionRunner
from wonderland_fira_uci.errors import UwbError


def now_ms():
    return int(time.monotonic() * 1000)


@dataclass
class Chatty:
    """A machine that has a frame to send all the time, and ends when it is told to."""

    session = None
    ticks: int = 0
    sent: int = 0

    def start(self, _now_ms):
        return []

    def handle(self, event, at_ms):
        if isinstance(event, Tick):
            self.ticks += 1
            return []
        return [Finish("decided", event, at_ms)]

    def next_tick_ms(self):
        return None

    def next_frames_ms(self):
        return now_ms()

    def frames_to_send(self, _now_ms):
        self.sent += 1
        return [b"frame"]


@dataclass
class Slow:
    """A node without credit: each frame takes its time, or fails."""

    takes_s: float
    error: Exception | None = None
    closed: int = 0
    under_way: list[bytes] = field(default_factory=list)

    async def send(self, frame):
        self.under_way.append(frame)
        await asyncio.sleep(self.takes_s)
        if self.error is not None:
            raise self.error

    async def close_session(self):
        self.closed += 1


class Runner(SessionRunner):
    def __init__(self, machine, speaker):
        super().__init__(machine, speaker=speaker, ledger=None, clock=now_ms)
        self.work = None

    async def _perform(self, action):
        self._finish = action


async def test_a_frame_that_waits_for_credit_lets_the_session_sleep():
    machine, node = Chatty(), Slow(0.5)
    runner = Runner(machine, node)
    running = asyncio.create_task(runner.run())
    await asyncio.sleep(0.4)
    assert len(node.under_way) == 1
    assert machine.ticks <= 2, "a look each 5 ms would be 80"
    runner.deliver("ended")
    assert (await running).end == "ended"
    assert node.closed == 1


async def test_a_frame_that_the_node_refuses_is_tried_again_without_spinning():
    machine, node = Chatty(), Slow(0.05, UwbError("no credit"))
    runner = Runner(machine, node)
    running = asyncio.create_task(runner.run())
    await asyncio.sleep(0.4)
    runner.deliver("ended")
    await running
    assert 3 <= len(node.under_way) <= 9
    assert machine.ticks <= 4 * len(node.under_way)


async def test_what_was_started_ends_with_the_session():
    machine, node = Chatty(), Slow(10)
    runner = Runner(machine, node)
    work = runner._start(asyncio.sleep(60))
    runner.deliver("ended")
    await asyncio.wait_for(runner.run(), 5)
    assert work.cancelled()
    assert node.closed == 1


async def test_an_error_of_the_machine_closes_the_radios():
    machine, node = Chatty(), Slow(10)
    runner = Runner(machine, node)
    machine.start = lambda _now_ms: 1 / 0
    with pytest.raises(ZeroDivisionError):
        await runner.run()
    assert node.closed == 1
