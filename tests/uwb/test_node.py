"""Real ports, virtual nodes: the whole way from the session layout to measurements and words."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan
from wonderland.uwb.link import Link, LinkKeys, MessageReceived, MessageType
from wonderland_fira_uci.errors import NodeClosedError, NodeUnavailableError, RangingPlanError
from wonderland_fira_uci.events import (
    DataFailed,
    DataReceived,
    FrameStamped,
    RangeMeasurement,
    RangingSilent,
    SessionFailed,
    SessionInterrupted,
    SessionStateChanged,
)
from wonderland_fira_uci.node import UwbNode, monotonic_ms
from wonderland_fira_uci.serial_port import PortTimings
from wonderland_fira_uci.session import UwbSession
from wonderland_fira_uci.uci.device import Timings
from wonderland_fira_uci.uci.errors import UciConfigRejectedError, UciStateError
from wonderland_fira_uci.uci.status import SessionState, Status
from wonderland_simulator.uci_node import SR150, Quirks

PAD = ("anchor-1", "anchor-2", "anchor-3", "anchor-4")
FAST = Timings(command_ms=200, reset_ms=150, ready_ms=100, backoff_ms=50, silence_ms=400)
FAST_PORT = PortTimings(backoff_s=0.02, backoff_max_s=0.1, stable_s=0.2)
Plan = Callable[..., RangingPlan]


def node(path: Path, **options: object) -> UwbNode:
    return UwbNode(path, timings=FAST, port_timings=FAST_PORT, **options)


async def until(condition: Callable[[], bool], limit_s: float = 5.0) -> None:
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("words", ["both_ways", "initiator"])
async def test_a_pad_and_a_drone_range_and_talk_and_no_radio_is_wanted_twice(world, plan: Plan, words: str) -> None:
    plan_ = plan(words=words, slot_duration_rstu=1200)
    world.distances = {name: 5_000 + 110 * i for i, name in enumerate(PAD)}
    world.air.data_loss = 0.2
    keys = LinkKeys(b"sess", b"a" * 16, b"b" * 16, b"c" * 13, b"d" * 13)
    pad_link, uav_link = Link("pad", keys, monotonic_ms), Link("uav", keys, monotonic_ms)
    quirks = Quirks(empty_data=True, responder_data=words == "both_ways")
    paths = {name: world.add(name, quirks) for name in (*PAD, "uav")}
    async with contextlib.AsyncExitStack() as stack:
        nodes = {name: await stack.enter_async_context(node(path)) for name, path in paths.items()}
        opened = await asyncio.gather(
            *(nodes[name].open_session(plan_.pad_ranging(i)) for i, name in enumerate(PAD)),
            nodes["uav"].open_session(plan_.uav_ranging()),
        )
        pad_a, uav_a = opened[:4], opened[4]
        pad_words, uav_words = plan_.pad_words(), plan_.uav_words()
        pad_b = pad_a[0] if pad_words is None else await nodes["anchor-1"].open_session(pad_words)
        uav_hears = {"uav ranging": uav_a}
        if uav_words is not None:
            uav_hears["uav"] = await nodes["uav"].open_session(uav_words)
        pad_link.send(MessageType.POLL, b"p" * 16)
        pad_link.send(MessageType.IDENTITY, b"\x01" + bytes(570))
        ranges: dict[str, list[RangeMeasurement]] = {name: [] for name in (*PAD, "uav")}
        heard: dict[str, list[MessageReceived]] = {"pad": [], "uav": []}

        async def agent(side: str, link: Link, out: UwbSession, sessions: dict[str, UwbSession]) -> None:
            while True:
                for name, session in sessions.items():
                    for event in session.events_nowait():
                        if isinstance(event, RangeMeasurement) and session.session_id == plan_.session_a_id:
                            ranges[name].append(event)
                        elif isinstance(event, DataReceived):
                            link.receive(event.data)
                for event in link.events():
                    assert isinstance(event, MessageReceived) or event.message_id >= 0
                    if isinstance(event, MessageReceived):
                        heard[side].append(event)
                        if event.message_type == MessageType.POLL:
                            link.send(MessageType.REPLY, b"u" * 16)
                while frames := link.frames_to_send(84):
                    await out.send(b"".join(frames))
                await asyncio.sleep(0.01)

        tasks = [
            asyncio.create_task(agent("pad", pad_link, pad_b, dict(zip(PAD, pad_a, strict=True)))),
            asyncio.create_task(agent("uav", uav_link, uav_a, uav_hears)),
        ]
        ranges["uav ranging"] = []
        await until(
            lambda: (
                min(len(ranges[name]) for name in PAD) >= 100
                and len(heard["uav"]) == 2
                and len(heard["pad"]) == 1
                and pad_link.idle
                and uav_link.idle
            ),
            20,
        )
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    assert world.air.collisions == 0
    assert [m.payload for m in heard["uav"]] == [b"p" * 16, b"\x01" + bytes(570)]
    assert [m.payload for m in heard["pad"]] == [b"u" * 16]
    assert pad_link.statistics.tag_failures == uav_link.statistics.tag_failures == 0
    for i, name in enumerate(PAD):
        assert {m.range_mm for m in ranges[name]} == {5_000 + 110 * i}
        assert {m.peer_mac for m in ranges[name]} == {plan_.uav_mac}
        assert {(m.status, m.nlos, m.rssi_dbm) for m in ranges[name]} == {(0, False, -78.5)}
        assert [m.sequence for m in ranges[name][:100]] == list(range(100))
    cross = {(m.peer_mac, m.range_mm) for m in ranges["uav ranging"]}
    assert cross == {(plan_.pad_macs[i], 5_000 + 110 * i) for i in range(4)}
    # Every pad node heard what the drone sent, whatever the destination said.
    assert pad_link.statistics.duplicates > 0


async def test_a_node_that_is_unplugged_comes_back_with_its_session(world, plan: Plan) -> None:
    plan_ = plan()
    states: list[tuple[bool, str]] = []
    async with node(world.add("uav")) as uav, node(world.add("anchor-1"), on_status=lambda *s: states.append(s)) as pad:
        lead = await uav.open_session(plan_.uav_ranging())
        session = await pad.open_session(plan_.pad_ranging(0))
        await until(lambda: any(isinstance(e, RangeMeasurement) for e in session.events_nowait()))
        world.ports["anchor-1"].unplug()
        await until(lambda: not pad.is_ready)
        assert not session.active
        assert "anchor-1" in pad.detail or pad.detail
        with pytest.raises(NodeUnavailableError, match="not ready"):
            await pad.wait_ready(0.05)
        with pytest.raises(NodeUnavailableError, match="away"):
            await session.send(b"x", timeout_s=0.05)
        lead.events_nowait()
        await until(lambda: any(isinstance(e, RangeMeasurement) and e.range_mm is None for e in lead.events_nowait()))
        world.ports["anchor-1"].plug()
        await until(lambda: session.active)
        kinds = [type(e) for e in session.events_nowait()]
        assert SessionInterrupted in kinds
        await until(lambda: any(isinstance(e, RangeMeasurement) for e in session.events_nowait()))
        assert [ready for ready, _ in states] == [True, False, True]


async def test_a_node_that_loses_power_behind_its_port_is_set_up_again(world, plan: Plan) -> None:
    async with node(world.add("anchor-1", Quirks(handle_offset=77))) as pad:
        session = await pad.open_session(plan().pad_ranging(0))
        world.ports["anchor-1"].node.power_off()  # not even a device READY: only silence tells
        await until(lambda: any(isinstance(e, SessionInterrupted) for e in session.events_nowait()))
        await until(lambda: session.active)
        world.ports["anchor-1"].node.power_on()  # a reboot announces itself
        await until(lambda: any(isinstance(e, SessionInterrupted) for e in session.events_nowait()))
        await until(lambda: session.active)


@pytest.mark.parametrize(
    "quirks",
    [
        Quirks(handle_offset=1_000),
        Quirks(no_ready=True),
        Quirks(keeps_duplicate=True),
        Quirks(knows_get_state=False),
        Quirks(drift=0.005, transfer_status=True, empty_data=True, report_failures=False),
    ],
)
async def test_nodes_with_quirks_range(world, plan: Plan, quirks: Quirks) -> None:
    plan_ = plan()
    async with node(world.add("uav", quirks)) as uav, node(world.add("anchor-2", quirks)) as pad:
        lead = await uav.open_session(plan_.uav_ranging())
        session = await pad.open_session(plan_.pad_ranging(1))
        await lead.send(b"hello")
        events: list[object] = []
        await until(lambda: bool(events.extend(session.events_nowait())) or DataReceived in map(type, events))
        [data] = [e for e in events if isinstance(e, DataReceived)]
        assert (data.data, data.source_mac) == (b"hello", plan_.uav_mac)
        assert any(isinstance(e, RangeMeasurement) and e.range_mm == 5_000 for e in events)
        await session.close()
        again = await pad.open_session(plan_.pad_ranging(1))
        assert again.active
        assert not any(isinstance(e, DataFailed) for e in lead.events_nowait())


async def test_a_wrong_sts_key_gives_no_range_and_no_words(world, plan: Plan) -> None:
    async with node(world.add("uav")) as uav, node(world.add("anchor-1")) as pad:
        lead = await uav.open_session(plan(sts_key=b"x" * 16).uav_ranging())
        session = await pad.open_session(plan().pad_ranging(0))
        session.events_nowait()
        await lead.send(b"hello")
        events: list[object] = []
        await until(lambda: bool(events.extend(session.events_nowait())) or len(events) >= 5)
        ranges = [e for e in events if isinstance(e, RangeMeasurement)]
        assert {(m.status, m.range_mm) for m in ranges} == {(Status.RANGING_RX_PHY_STS_FAILED, None)}
        assert not [e for e in events if isinstance(e, DataReceived)]


async def test_a_controlee_alone_hears_nobody(world, plan: Plan) -> None:
    async with node(world.add("anchor-1")) as pad:
        session = await pad.open_session(plan().pad_ranging(0))
        await until(lambda: any(isinstance(e, RangingSilent) for e in session.events_nowait()))
        await session.close()
        assert session.closed
        rest = [e async for e in session.events() if not isinstance(e, RangingSilent)]
        assert [e.state for e in rest] == [SessionState.IDLE]
        with pytest.raises(NodeClosedError):
            await session.send(b"x")


async def test_events_are_streamed_in_order_and_end(world, plan: Plan) -> None:
    async with node(world.add("anchor-1")) as pad:
        session = await pad.open_session(plan().pad_ranging(0))
        seen = []

        async def read() -> None:
            async for event in session.events():
                seen.append(event)  # noqa: PERF401 - read while it grows

        reader = asyncio.create_task(read())
        await until(lambda: len(seen) >= 6)
        await session.close()
        await asyncio.wait_for(reader, 1)
    states = [e.state for e in seen if isinstance(e, SessionStateChanged)]
    assert states[:3] == [SessionState.INIT, SessionState.IDLE, SessionState.ACTIVE]
    sequences = [e.sequence for e in seen if isinstance(e, RangingSilent)]
    assert sequences == list(range(len(sequences)))


async def test_a_refused_configuration_names_the_parameter(world, plan: Plan) -> None:
    async with node(world.add("anchor-1")) as pad:
        config = plan().pad_ranging(0)
        object.__setattr__(config.app, "interval_ms", 1)
        with pytest.raises(UciConfigRejectedError, match="RANGING_INTERVAL") as caught:
            await pad.open_session(config)
        assert caught.value.parameters == {0x09: Status.INVALID_PARAMETER}
        assert (await pad.open_session(plan().pad_ranging(0))).active  # the node and the id are free again


async def test_the_same_session_twice_on_a_node_is_refused(world, plan: Plan) -> None:
    async with node(world.add("anchor-1")) as pad:
        first = await pad.open_session(plan().pad_ranging(0))
        with pytest.raises(UciStateError, match="already open"):
            await pad.open_session(plan().pad_ranging(0))
        assert first.active


async def test_a_session_left_by_a_crashed_agent_is_cleared_by_the_reset(world, plan: Plan) -> None:
    path = world.add("anchor-1")
    first = node(path)
    await first.__aenter__()
    await first.open_session(plan().pad_ranging(0))
    first._port.close()  # as if the process had died: no STOP, no DEINIT
    await asyncio.sleep(0.2)
    async with node(path) as second:
        session = await second.open_session(plan().pad_ranging(0))
        assert session.active
    await first.close()


async def test_a_second_agent_on_the_same_port_is_told(world) -> None:
    path = world.add("anchor-1")
    async with node(path) as first, node(path) as second:
        await first.wait_ready()
        with pytest.raises(NodeUnavailableError, match="cannot be opened"):
            await second.wait_ready(0.3)
    async with node(path) as third:
        await third.wait_ready()


async def test_a_missing_port_and_a_silent_node_are_named(tmp_path: Path, world, plan: Plan) -> None:
    async with node(tmp_path / "nothing") as lost:
        with pytest.raises(NodeUnavailableError, match="nothing"):
            await lost.open_session(plan().pad_ranging(0), timeout_s=0.2)
    path = world.add("anchor-1")
    world.ports["anchor-1"].node.receive = lambda _data: None
    async with node(path) as mute:
        with pytest.raises(NodeUnavailableError, match="CORE_RESET was not answered"):
            await mute.wait_ready(0.4)


async def test_garbage_on_the_line_is_survived(world, plan: Plan) -> None:
    rng = random.Random(5)
    async with node(world.add("anchor-1")) as pad, node(world.add("uav")) as uav:
        lead = await uav.open_session(plan().uav_ranging())
        session = await pad.open_session(plan().pad_ranging(0))
        for garbage in (
            b"\xff" * 40,
            rng.randbytes(300),
            b"\x62\x00\x00\xff",
            b"\x02\x00\xff\x0f",
            b"AN3,15BA,0.00,0,",
        ):
            world.ports["anchor-1"]._write(garbage)
            await asyncio.sleep(0.12)
            session.events_nowait()
            await until(lambda: any(isinstance(e, RangeMeasurement) for e in session.events_nowait()))
        assert lead.active


async def test_data_limits_and_credit(world, plan: Plan) -> None:
    plan_ = plan()
    quirks = Quirks(data_queue=1, frames_per_round=1)
    async with node(world.add("uav", quirks)) as uav, node(world.add("anchor-1")) as pad:
        lead = await uav.open_session(plan_.uav_ranging())
        session = await pad.open_session(plan_.pad_ranging(0))
        started = time.monotonic()
        for number in range(6):
            await lead.send(bytes((number,)) * 80)
        assert time.monotonic() - started > 4 * plan_.interval_ms / 1000  # one frame in each round
        heard: list[bytes] = []
        await until(
            lambda: (
                bool(heard.extend(e.data for e in session.events_nowait() if isinstance(e, DataReceived)))
                or len(heard) == 6
            )
        )
        assert heard == [bytes((number,)) * 80 for number in range(6)]
        await lead.send(bytes(85))
        failed: list[DataFailed] = []
        await until(lambda: bool(failed.extend(e for e in lead.events_nowait() if isinstance(e, DataFailed)) or failed))
        with pytest.raises(UciStateError, match="2031"):
            await lead.send(bytes(3_000))
        with pytest.raises(UciStateError, match="1 to"):
            await lead.send(b"")


async def test_closing_a_node_ends_its_sessions_and_frees_the_port(world, plan: Plan) -> None:
    path = world.add("anchor-1")
    async with node(path) as pad:
        session = await pad.open_session(plan().pad_ranging(0))
    assert session.closed
    assert world.ports["anchor-1"].node.sessions == {}
    with pytest.raises(NodeClosedError):
        await pad.open_session(plan().pad_ranging(0))
    assert not [e for e in session.events_nowait() if isinstance(e, SessionFailed)]


async def test_giving_up_on_a_session_leaves_nothing_behind(world, plan: Plan) -> None:
    async with node(world.add("anchor-1")) as pad:
        await pad.wait_ready()
        task = asyncio.create_task(pad.open_session(plan().pad_ranging(0)))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        again = await pad.open_session(plan().pad_ranging(0))  # at once: it waits until the first is gone
        assert again.active
        await again.close()
        assert world.ports["anchor-1"].node.sessions == {}


async def test_an_attacker_on_the_air_can_drop_and_change_words_and_distance_can_end_them(world, plan: Plan) -> None:
    plan_ = plan()
    world.air.intercept = lambda sender, receiver, data: None if data == b"drop" else data.upper()
    async with node(world.add("uav")) as uav, node(world.add("anchor-1")) as pad:
        lead = await uav.open_session(plan_.uav_ranging())
        session = await pad.open_session(plan_.pad_ranging(0))
        await lead.send(b"drop")
        await lead.send(b"word")
        heard: list[bytes] = []

        def listen() -> bool:
            heard.extend(e.data for e in session.events_nowait() if isinstance(e, DataReceived))
            return bool(heard)

        await until(listen)
        assert heard == [b"WORD"]
        world.distances["anchor-1"] = None
        await lead.send(b"nobody hears this")
        missed: list[RangeMeasurement] = []

        def misses() -> int:
            reports = [e for e in lead.events_nowait() if isinstance(e, RangeMeasurement)]
            missed.extend(e for e in reports if e.peer_mac == plan_.pad_macs[0] and e.range_mm is None)
            return len(missed)

        await until(lambda: misses() >= 4)
        assert {e.status for e in missed} == {Status.RANGING_RX_TIMEOUT}
        assert not [e for e in session.events_nowait() if isinstance(e, DataReceived)]


async def test_the_newest_events_are_kept_when_nobody_reads(world, plan: Plan) -> None:
    async with node(world.add("anchor-1")) as pad:
        session = await pad.open_session(plan().pad_ranging(0))
        for number in range(5_000):
            session.push(RangingSilent(0, 0, number))
        assert session.events_dropped >= 900
        assert session.events_nowait()[-1] == RangingSilent(0, 0, 4_999)


async def test_four_nodes_time_stamp_the_same_blinks_and_hear_their_payload(world) -> None:
    plan_ = BlinkPlan(
        session_id=0x8000_0001, pad_macs=(0xA001, 0xA002, 0xA003, 0xA004), uav_mac=0xD001, sts_key=b"k" * 16
    )
    other = BlinkPlan(session_id=0x8000_0001, pad_macs=plan_.pad_macs, uav_mac=plan_.uav_mac, sts_key=b"x" * 16)
    world.air.stamp = lambda anchor, tag, t_s: 2**40 - 5 + PAD.index(anchor) * 100
    paths = {name: world.add(name, profile=SR150) for name in (*PAD, "uav")}
    async with contextlib.AsyncExitStack() as stack:
        nodes = {name: await stack.enter_async_context(node(path)) for name, path in paths.items()}
        tag = await nodes["uav"].open_session(plan_.uav_tag())
        anchors = [await nodes[name].open_session(plan_.pad_anchor(index)) for index, name in enumerate(PAD[:3])]
        anchors.append(await nodes[PAD[3]].open_session(other.pad_anchor(3)))  # another key: it hears nothing
        await tag.send(b"answer")
        heard: list[list[FrameStamped]] = [[] for _ in anchors]

        def gather() -> bool:
            for session, seen in zip(anchors, heard, strict=True):
                seen += [event for event in session.events_nowait() if isinstance(event, FrameStamped)]
            return all(len([event for event in seen if event.payload == b"answer"]) >= 3 for seen in heard[:3])

        await until(gather, 20.0)
    assert not heard[3]
    numbers = {event.number for event in heard[0]} & {event.number for event in heard[1]}
    assert numbers, "the tag's own count is the same at every node"
    assert {event.ticks for event in heard[0]} == {2**40 - 5}
    assert {event.ticks for event in heard[1]} == {95}, "the counter has 40 bits"
    assert {event.tag_mac for event in heard[2]} == {0xD001}


@pytest.mark.parametrize(
    "change",
    [
        {"session_id": 0},
        {"pad_macs": ()},
        {"uav_mac": 0xA001},
        {"sts_key": b"short"},
        {"interval_ms": 5},
        {"interval_ms": 60_001},
        {"payload": bytes(17)},
    ],
)
def test_a_plan_of_blinks_that_cannot_work_is_refused(change: dict[str, object]) -> None:
    good: dict[str, object] = {"session_id": 1, "pad_macs": (0xA001, 0xA002), "uav_mac": 0xD001, "sts_key": bytes(16)}
    BlinkPlan(**good)  # type: ignore[arg-type]
    with pytest.raises(RangingPlanError):
        BlinkPlan(**(good | change))  # type: ignore[arg-type]


@pytest.mark.parametrize("anchors", [6, 8])
async def test_pads_of_six_and_eight_range_with_all_of_their_nodes(world, plan: Plan, anchors: int) -> None:
    names = [f"anchor-{index}" for index in range(1, anchors + 1)]
    plan_ = plan(pad_macs=tuple(0xA001 + index for index in range(anchors)))
    paths = {name: world.add(name) for name in (*names, "uav")}
    async with contextlib.AsyncExitStack() as stack:
        nodes = {name: await stack.enter_async_context(node(path)) for name, path in paths.items()}
        opened = await asyncio.gather(
            *(nodes[name].open_session(plan_.pad_ranging(index)) for index, name in enumerate(names)),
            nodes["uav"].open_session(plan_.uav_ranging()),
        )
        counts = [0] * anchors

        def all_ranged() -> bool:
            for index, session in enumerate(opened[:anchors]):
                counts[index] += sum(isinstance(event, RangeMeasurement) for event in session.events_nowait())
            return min(counts) >= 5

        await until(all_ranged)


async def test_a_node_that_leads_refuses_fewer_slots_than_a_round_takes(world, plan: Plan) -> None:
    leading = plan().uav_ranging()
    short = dataclasses.replace(leading, app=dataclasses.replace(leading.app, slots_per_round=11))
    async with node(world.add("uav")) as uav:
        with pytest.raises(UciConfigRejectedError, match="SLOTS_PER_RR"):
            await uav.open_session(short)
