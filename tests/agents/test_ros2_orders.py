"""Orders to a drone by ROS 2: whole proofs on a real ledger, by our client and one that is none of ours; and nuisances."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
import uuid

import pytest
from click.testing import CliRunner
from kit.agents import open_ledger
from kit.ros2 import TYPES, SdkPeer, router

from wonderland.clock import SteadyClock
from wonderland_rmw_zenoh.errors import CallError
from wonderland_rmw_zenoh.node import Node
from wonderland_uav_agent.commands import uav as uav_commands
from wonderland_uav_agent.ros2_orders import OrdersError, Ros2Orders, link_of
from wonderland_uav_agent.willing import Willing

KIND = TYPES.action("wonderland_msgs/action/ProveLocation")
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


def new_id():
    return {"uuid": list(uuid.uuid4().bytes)}


class Client:
    """A client of the action of a drone's node."""

    def __init__(self, node, name):
        self._node = node
        self.action = f"{name}/prove_location/_action"

    async def ready(self):
        assert await self._node.wait_for("SS", f"{self.action}/get_result", 10)
        return self

    async def order(self, goal_id, **goal):
        asked = {"goal_id": goal_id, "goal": {"pad_id": "pad-1", "purpose": "land"} | goal}
        return (await self._node.call(f"{self.action}/send_goal", KIND.send_goal, asked)).accepted

    async def result(self, goal_id):
        return await self._node.call(f"{self.action}/get_result", KIND.get_result, {"goal_id": goal_id}, 30)

    async def cancel(self, goal_id):
        return await self._node.call(f"{self.action}/cancel_goal", KIND.cancel, {"goal_info": {"goal_id": goal_id}})


class Proving:
    """An agent whose proof ends when it is told."""

    def __init__(self):
        self.asked = []
        self.ends = asyncio.Event()

    async def prove(self, pad_id, action):
        self.asked.append((pad_id, action))
        await self.ends.wait()

    def stop(self, reason="drone_stopped"):
        self.ends.set()


@contextlib.asynccontextmanager
async def orders(where, agent, uav_id="drone-1"):
    willing = Willing(agent, frozenset({"pad-1"}))
    async with Ros2Orders(f"ros2:{where.endpoint}", uav_id, willing, SteadyClock()) as made:
        working = asyncio.create_task(made.run())
        try:
            yield made
        finally:
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            await willing.stop()


async def test_an_ordered_proof_comes_to_its_verdict_and_permits_by_the_ledger_alone(world):
    told = []
    async with (
        router() as where,
        world.pad(),
        world.uav(on_step=lambda session, report: [each(session, report) for each in told]) as uav,
        orders(where, uav, uav.uav_id) as made,
        Node("/mission", where.link) as node,
        SdkPeer.at(where) as peer,
    ):
        told.append(made.step)
        client = await Client(node, made._node.name).ready()
        steps = []

        async def take(arrived):
            steps.append(KIND.feedback.codec.decode(arrived.data).feedback.step)

        node.subscribe(f"{client.action}/feedback", take, depth=1_000)
        goal_id = new_id()
        assert await client.order(goal_id, uav_id=uav.uav_id)
        assert not await client.order(new_id()), "one proof at a time"
        found = await client.result(goal_id)
        assert len(found.result.session_id) > 10
        session = await world.contract("uav").read_session(found.result.session_id)
        assert session.uav_id == uav.uav_id
        granted = (found.result.outcome, found.result.permission) == ("verified", "granted")
        assert found.status == (SUCCEEDED if granted else ABORTED)
        assert [each.session_id for each in world.acted] == ([found.result.session_id] if granted else [])
        async with asyncio.timeout(10):
            while "request" not in steps and "poll" not in steps:
                await asyncio.sleep(0.05)
        services = {}
        async with asyncio.timeout(15):
            while f"{client.action}/send_goal" not in services:
                services = dict(map(tuple, (await peer.asked("services"))["services"]))
        assert services[f"{client.action}/send_goal"] == ["wonderland_msgs/action/ProveLocation_SendGoal"]


async def test_orders_for_others_places_and_purposes_are_refused_and_nothing_begins():
    agent = Proving()
    async with router() as where, orders(where, agent) as made, Node("/mission", where.link) as node:
        client = await Client(node, made._node.name).ready()
        for bad in (
            {"uav_id": "drone-2"},
            {"pad_id": "pad-2"},
            {"pad_id": ""},
            {"purpose": "fly"},
            {"purpose": "land" * 10_000},
            {"uav_id": "x" * 30_000},
        ):
            assert not await client.order(new_id(), **bad), bad
        assert agent.asked == []
        with pytest.raises(CallError, match="more than"):
            await client.order(new_id(), uav_id="x" * 70_000)
        assert await client.order(new_id(), uav_id="", wait_s=float("nan")), "wait_s is the pad's"
        await asyncio.sleep(0.1)
        assert agent.asked == [("pad-1", "land")]


async def test_a_flood_of_orders_is_one_proof_and_the_node_answers_after_it():
    agent = Proving()
    async with router() as where, orders(where, agent) as made, Node("/mission", where.link) as node:
        client = await Client(node, made._node.name).ready()
        answers = await asyncio.gather(*(client.order(new_id()) for _ in range(500)), return_exceptions=True)
        accepted = [each for each in answers if each is True]
        assert len(accepted) == 1, answers[:5]
        await asyncio.sleep(0.1)
        assert agent.asked == [("pad-1", "land")]
        agent.ends.set()
        await asyncio.sleep(0.1)
        assert await client.order(new_id())


async def test_a_goal_that_is_taken_back_ends_and_the_proof_goes_on():
    agent = Proving()
    async with router() as where, orders(where, agent) as made, Node("/mission", where.link) as node:
        client = await Client(node, made._node.name).ready()
        goal_id = new_id()
        assert await client.order(goal_id)
        waiting = asyncio.create_task(client.result(goal_id))
        assert [bytes(each.goal_id.uuid) for each in (await client.cancel(goal_id)).goals_canceling] == [
            bytes(goal_id["uuid"])
        ]
        found = await waiting
        assert found.status == CANCELED
        assert "goes on" in found.result.reason
        assert not agent.ends.is_set()
        assert not await client.order(new_id()), "it is still under way"
        agent.ends.set()


async def test_what_is_no_request_is_answered_and_harms_nothing():
    agent = Proving()
    async with router() as where, orders(where, agent) as made, Node("/mission", where.link) as node:
        client = await Client(node, made._node.name).ready()
        key = f"0{client.action}/send_goal/{KIND.send_goal.name.replace('/', '::').replace('::action::', '::action::dds_::')}_"
        key = f"{key}/{KIND.send_goal.hash}"
        for payload, attachment in ((b"", None), (b"\xff" * 64, b"\0" * 33), (b"\0\1\0\0", b"\0" * 3)):
            replies = await asyncio.to_thread(
                lambda payload=payload, attachment=attachment: list(
                    node.session.get(key, payload=payload, attachment=attachment, timeout=5.0)
                )
            )
            assert all(each.ok is None for each in replies)
        assert await client.order(new_id())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ros2:tcp/10.0.0.1:7447", "another machine's"),
        ("ros2:nonsense", "no address"),
        ("ros1", "orders come by ros2"),
    ],
)
def test_what_takes_no_orders_says_what_to_give(text, says):
    with pytest.raises(OrdersError, match=says):
        link_of(text)


def test_somebody_has_to_ask():
    given = ["serve", "--connection", "x.json", "--port", "/dev/null", "--position", "udp:127.0.0.1:0", "--pad", "p"]
    result = CliRunner().invoke(uav_commands, given)
    assert result.exit_code == 2
    assert "--backend, --orders or [flight]" in result.output


async def test_a_process_without_a_backend_takes_orders_and_says_what_it_lacks(tmp_path):
    ledger = open_ledger(tmp_path)
    await ledger.start()
    try:
        async with router() as where, Node("/mission", where.link) as node:
            command = [sys.executable, "-m", "wonderland.cli", "uav", "serve", "--pad", "pad-1"]
            command += ["--connection", tmp_path / "ledger" / "connection.json", "--port", tmp_path / "tty-uav"]
            command += ["--position", "udp:127.0.0.1:0", "--orders", f"ros2:{where.endpoint}"]
            process = await asyncio.create_subprocess_exec(*map(str, command), stderr=asyncio.subprocess.PIPE)
            try:
                async with asyncio.timeout(30):
                    while not (
                        found := [each for each in node.endpoints("SS") if each.node.startswith("/wonderland/")]
                    ):
                        await asyncio.sleep(0.1)
                client = await Client(node, found[0].node).ready()
                assert not await client.order(new_id())
                async with asyncio.timeout(10):
                    while b"no position" not in (line := await process.stderr.readline()) or b"goal" not in line:
                        assert line
                process.send_signal(signal.SIGTERM)
                assert await asyncio.wait_for(process.wait(), 10) == 0
            finally:
                if process.returncode is None:
                    process.kill()
                    await process.wait()
    finally:
        await ledger.stop()
