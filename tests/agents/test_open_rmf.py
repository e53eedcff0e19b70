"""A pad as a door of Open-RMF: whole proofs on a real ledger, liars on the topics, and what goes away while it is open."""

from __future__ import annotations

import asyncio
import logging
import sys
from contextlib import asynccontextmanager

from kit.agents import decided
from kit.ros2 import TYPES, SdkPeer, pad_node, parts_of, router

from wonderland import telemetry
from wonderland_rmw_zenoh.node import Node
from wonderland_rmw_zenoh.wire import Attachment, Qos
from wonderland_ros_bridge.ros2.door import CLOSED, MOVING, OFFLINE, OPEN, claimant
from wonderland_ros_bridge.ros2.settings import OpenRmfSettings

STATE = "rmf_door_msgs/msg/DoorState"
REQUEST = "rmf_door_msgs/msg/DoorRequest"
ALERT = "rmf_task_msgs/msg/Alert"
QUEUE = "rmf_ingestor_msgs/msg/IngestorState"
LOCK = "rmf_fleet_msgs/msg/MutexGroupRequest"
GROUPS = "rmf_fleet_msgs/msg/MutexGroupStates"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
DOOR = OpenRmfSettings(mutex_group="roof")
TOPICS = {
    "/door_states": STATE,
    "/alert": ALERT,
    "/ingestor_states": QUEUE,
    "/mutex_group_request": LOCK,
    "/diagnostics": DIAGNOSTICS,
}


class Rmf:
    """Somebody of RMF's: hears the pad, and publishes what it likes."""

    def __init__(self, node):
        self.node = node
        self.heard = {name: [] for name in TOPICS}
        self._publications = {}
        for name, kind in TOPICS.items():
            node.subscribe(name, self._take, kind=TYPES.message(kind), depth=1_000)

    async def _take(self, arrived):
        self.heard[arrived.topic].append(TYPES.of_hash(arrived.type, arrived.type_hash).codec.decode(arrived.data))

    async def say(self, name, kind, qos=None, **message):
        if name not in self._publications:
            self._publications[name] = self.node.advertise(name, TYPES.message(kind), qos)
            await asyncio.sleep(0.5)  # what is said before two sessions are linked is lost, as ever in ROS
        await self._publications[name].publish(message)

    async def ask(self, mode=OPEN, *, by="fleet/robot", door="pad-1", topic="/door_requests"):
        await self.say(topic, REQUEST, requester_id=by, door_name=door, requested_mode={"value": mode})

    @property
    def modes(self):
        """The door's, without repetitions."""
        found = [each.current_mode.value for each in self.heard["/door_states"] if each.door_name == "pad-1"]
        return [each for index, each in enumerate(found) if index == 0 or each != found[index - 1]]

    def door(self):
        """What diagnostics say of it."""
        statuses = [each for array in self.heard["/diagnostics"] for each in array.status if "door" in each.name]
        return statuses[-1].level, {each.key: each.value for each in statuses[-1].values}

    async def until(self, fits, limit_s=10.0):
        try:
            async with asyncio.timeout(limit_s):
                while not fits():
                    await asyncio.sleep(0.02)
        except TimeoutError:
            raise AssertionError(f"the door was {self.modes}") from None

    async def stands(self, mode, limit_s=10.0):
        await self.until(lambda: self.modes[-1:] == [mode], limit_s)


@asynccontextmanager
async def rmf(where):
    async with Node("/somebody_of_rmf", where.link) as node:
        yield Rmf(node)


def hold():
    """A drone that is permitted, and hovers until it is told to land."""
    go = asyncio.Event()

    async def act(_verdict):
        await go.wait()
        return "done"

    return go, act


async def test_a_proof_opens_the_door_and_a_wish_does_not(world):
    go, act = hold()
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav(act=act) as uav,
    ):
        await seen.stands(CLOSED)
        await seen.ask(by="fleet/robot", topic="/adapter_door_requests")
        await seen.ask(by="door_supervisor")
        await seen.stands(MOVING)
        await seen.until(lambda: seen.door()[1]["asked_for_by"] == "fleet/robot, door_supervisor")
        for by, topic in (("fleet/robot", "/adapter_door_requests"), ("door_supervisor", "/door_requests")):
            await seen.ask(CLOSED, by=by, topic=topic)
        await seen.stands(CLOSED)
        assert OPEN not in seen.modes, "only a proof opens it"
        proof = asyncio.create_task(decided(uav))
        await seen.stands(OPEN, 20)
        assert seen.modes[-2:] == [MOVING, OPEN]
        await seen.ask(CLOSED, by="door_supervisor")  # what RMF's supervisor says to an open door that nobody asked for
        # The door may be heard before the queue in which the drone no longer waits, but has the pad.
        await seen.until(lambda: seen.heard["/ingestor_states"][-1].seconds_remaining > 0)
        queue = seen.heard["/ingestor_states"][-1]
        await seen.until(lambda: seen.heard["/mutex_group_request"])
        locked = seen.heard["/mutex_group_request"][-1]
        await asyncio.sleep(1.0)
        assert seen.modes[-1] == OPEN, "the drone has its permission, whatever RMF asks"
        # RMF forgets a lock that is not repeated within ten seconds.
        await seen.until(lambda: len([each for each in seen.heard["/mutex_group_request"] if each.mode == 1]) >= 3)
        locks = [each for each in seen.heard["/mutex_group_request"] if each.mode == 1]
        assert len({each.claim_time.sec * 10**9 + each.claim_time.nanosec for each in locks}) == 1
        go.set()
        result = await proof
        await seen.stands(CLOSED)
        assert queue.guid == "pad-1"
        assert queue.mode == 1
        assert queue.request_guid_queue == [f"uav-1 land {result.session_id}"]
        assert queue.seconds_remaining > 0
        assert (locked.group, locked.claimant, locked.mode) == ("roof", claimant("pad-1"), 1)
        await seen.until(lambda: seen.heard["/mutex_group_request"][-1].mode == 0)
        assert seen.heard["/alert"] == []


async def test_a_refusal_closes_the_door_and_alerts(world):
    world.flight.claimed = (40_000.0, 3_000.0, 6_000.0)
    async with (
        router() as where,
        SdkPeer.at(where) as peer,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav() as uav,
    ):
        for name, kind in (("/alert", ALERT), ("/door_states", STATE)):
            said = await peer.asked("subscribe", topic=name, **parts_of(kind))
            assert said["hash"] == TYPES.message(kind).hash, "two implementations of the type hash"
        await seen.ask()
        await seen.stands(MOVING)
        result = await decided(uav)
        assert result.verdict.outcome == "refuted"
        alert = await peer.heard("/alert")
        assert alert["id"] == f"wonderland-{result.session_id}-refuted"
        assert alert["tier"] == 2
        assert alert["display"] is True
        assert {"name": "tx_id", "value": result.verdict_tx} in alert["alert_parameters"]
        assert alert["message"]
        await seen.stands(CLOSED)
        for _ in range(3):  # as RMF repeats it
            await seen.ask()
        await asyncio.sleep(1.5)
        assert seen.modes[-2:] == [MOVING, CLOSED], "answered, until somebody asks anew"
        await seen.ask(CLOSED)
        await seen.ask()
        await seen.stands(MOVING)
        assert OPEN not in seen.modes
        heard = await peer.heard("/door_states")
        assert heard["door_name"] == "pad-1"


async def test_liars_on_the_topics_open_nothing_and_are_seen(world, caplog):
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR) as pad,
        world.pad(local_reports="reports.sock"),
        Node("/liar", where.link) as liar,
    ):
        await seen.stands(CLOSED)
        lies = Rmf(liar)
        caplog.set_level(logging.INFO)
        for index in range(1_000):
            await lies.ask(by=f"liar {index}")
        await seen.stands(MOVING)
        assert len(pad._door._wishes.held(world.clock())) <= 64
        await seen.until(lambda: "and 59 more" in seen.door()[1]["asked_for_by"])
        before = len(caplog.records)
        for index in range(200):  # two of them, and their own change of mind
            await lies.ask(CLOSED if index % 2 else OPEN, by="flutter")
        for bad in ({"by": ""}, {"by": "x" * 201}, {"mode": 1}, {"mode": 7}, {"door": "another"}, {"by": "\n"}):
            await lies.ask(**{"by": "liar", "mode": OPEN} | bad)
        await lies.ask(door="x" * 1_000_000)
        wrong = liar.advertise("/door_requests", TYPES.message("std_msgs/msg/String"))
        await wrong.publish({"data": "open"})
        forged = {"requester_id": "of another hash", "door_name": "pad-1", "requested_mode": {"value": OPEN}}
        data = TYPES.message(REQUEST).codec.encode(forged)
        for kind, hashed in (("DoorRequest", "0" * 64), ("DoorWish", TYPES.message(REQUEST).hash[7:])):
            key = f"0/door_requests/rmf_door_msgs::msg::dds_::{kind}_/RIHS01_{hashed}"
            liar.session.put(key, data, attachment=Attachment(1, 2, b"g" * 16).encode())
        await asyncio.sleep(1.0)
        said = [each.getMessage() for each in caplog.records[before:]]
        held = pad._door._wishes.held(world.clock())
        assert "liar 999" in held
        assert "of another hash" not in held
        assert len(said) < 10, "nobody's flood fills the log"
        for part in ("more than 4096 bytes", "printable letters", "another mode", "no rmf_door_msgs/msg/DoorRequest"):
            assert any(part in each for each in said), part
        # The pad's own word, by somebody else: it stands until the pad speaks again, and is named.
        for _ in range(3):
            await lies.say("/door_states", STATE, door_name="pad-1", current_mode={"value": OPEN})
        await seen.until(lambda: seen.door()[0] == 2)
        await seen.stands(MOVING)
        found = [each.getMessage() for each in caplog.records if "somebody else publishes" in each.getMessage()]
        assert len(found) == 1
        assert "/liar" in found[0]


async def test_a_word_of_the_pads_own_is_not_taken_for_its_own_when_it_is_replayed(world, caplog):
    go, act = hold()
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav(act=act) as uav,
        Node("/replayer", where.link) as replayer,
    ):
        caught = []

        async def keep(arrived):
            caught.append(arrived.data)

        kind = TYPES.message(STATE)
        replayer.subscribe("/door_states", keep, kind=kind)
        proof = asyncio.create_task(decided(uav))
        await seen.stands(OPEN, 20)
        await asyncio.sleep(0.3)
        opened = caught[-1]
        assert kind.codec.decode(opened).current_mode.value == OPEN
        go.set()
        await proof
        await seen.stands(CLOSED)
        assert not any("somebody else" in each.getMessage() for each in caplog.records), "its own are its own"
        again = replayer.advertise("/door_states", kind)
        await asyncio.sleep(0.5)
        await again.publish_bytes(opened)
        await seen.until(lambda: any("/replayer" in each.getMessage() for each in caplog.records))
        await seen.stands(CLOSED)


async def test_two_nodes_of_one_door_find_each_other_and_do_not_outdo_each_other(world, caplog):
    """A pad whose node was started twice; each is the other's stranger."""
    other = world.directory / "other"
    other.mkdir()
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        pad_node(world, where, open_rmf=DOOR, reports=other / "reports.sock"),
    ):
        await seen.until(lambda: sum("somebody else publishes" in each.getMessage() for each in caplog.records) == 2)
        before = len(seen.heard["/door_states"])
        await asyncio.sleep(3.0)
        assert len(seen.heard["/door_states"]) - before <= 70, "ten a second each, at most"
        assert sum("somebody else publishes" in each.getMessage() for each in caplog.records) == 2


async def test_a_permission_that_lapses_closes_the_door_and_alerts(world):
    _, act = hold()
    await world.policy(session_ttl_ms=10_000)
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav(act=act) as uav,
    ):
        proof = asyncio.create_task(uav.prove("pad-1", "land"))
        await seen.stands(OPEN, 20)
        await seen.stands(CLOSED, 20)
        await seen.until(lambda: seen.heard["/alert"])
        assert "permission_expired" in seen.heard["/alert"][-1].id
        assert seen.heard["/alert"][-1].tier == 1
        proof.cancel()
        await asyncio.gather(proof, return_exceptions=True)


async def test_a_ledger_that_goes_away_while_the_door_is_open_takes_it_offline(world):
    _, act = hold()
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav(act=act) as uav,
    ):
        proof = asyncio.create_task(uav.prove("pad-1", "land"))
        await seen.stands(OPEN, 20)
        restarted = asyncio.create_task(world.restart_ledger(8.0))
        await seen.stands(OFFLINE, 15)
        await restarted
        await seen.until(lambda: seen.modes[-1] in {OPEN, CLOSED}, 30)
        assert seen.heard["/mutex_group_request"][-1].mode in {0, 1}
        proof.cancel()
        await asyncio.gather(proof, return_exceptions=True)


async def test_an_agent_that_is_killed_while_the_door_is_open_does_not_leave_it_open(world):
    ahead_ms = 0
    _, act = hold()
    async with (
        router() as where,
        rmf(where) as seen,
        world.uav(act=act) as uav,
        pad_node(world, where, open_rmf=DOOR, clock=lambda: world.clock() + ahead_ms),
    ):
        await seen.stands(OFFLINE)
        async with world.pad(local_reports="reports.sock"):
            proof = asyncio.create_task(uav.prove("pad-1", "land"))
            await seen.stands(OPEN, 20)
        ahead_ms = 18_000
        await asyncio.sleep(0.5)
        assert seen.modes[-1] == OPEN
        ahead_ms = 26_000
        await seen.stands(OFFLINE, 5)
        await seen.until(lambda: seen.heard["/mutex_group_request"][-1].mode == 0)
        proof.cancel()
        await asyncio.gather(proof, return_exceptions=True)


async def test_a_node_that_ends_says_offline_and_one_that_comes_does_not_open_for_what_is_over(world):
    async with router() as where, rmf(where) as seen:
        async with world.pad(local_reports="reports.sock"), world.uav() as uav:
            async with pad_node(world, where, open_rmf=DOOR):
                await seen.stands(CLOSED)
                assert (await decided(uav)).verdict.permission == "granted"
                await seen.until(lambda: OPEN in seen.modes)
                await seen.stands(CLOSED)
            await seen.stands(OFFLINE)
        seen.heard["/door_states"].clear()
        async with pad_node(world, where, open_rmf=DOOR), world.pad(local_reports="reports.sock"):
            await seen.stands(CLOSED)
            await asyncio.sleep(1.0)
            assert OPEN not in seen.modes, "the permission was used before"


async def test_the_command_tells_the_door_and_ends_with_offline(world):
    """``wonderland ros2 run`` as a service manager starts and stops it."""
    config = world.directory / "ros2.toml"
    connection = world.directory / "ledger" / "connection.json"
    async with router() as where, rmf(where) as seen:
        config.write_text(
            f'[ledger]\nconnection = "{connection}"\nidentity = "mirror"\n[ros2]\nconnect = ["{where.endpoint}"]\n'
            '[pad]\npad_id = "pad-1"\nreports = "reports.sock"\n[pad.open_rmf]\ndoor = "roof"\n'
        )
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "wonderland.cli", "ros2", "run", "--json", "--config", str(config), stdout=-1
        )
        try:
            async with asyncio.timeout(30):
                assert b"ready" in await process.stdout.readline()
            async with world.pad(local_reports="reports.sock"):
                await seen.until(lambda: "roof" in {each.door_name for each in seen.heard["/door_states"]})
                await seen.until(lambda: seen.heard["/door_states"][-1].current_mode.value == CLOSED)
                process.terminate()
                assert await asyncio.wait_for(process.wait(), 10) == 0
            await seen.until(lambda: seen.heard["/door_states"][-1].current_mode.value == OFFLINE)
            assert seen.heard["/mutex_group_request"] == [], "no group is named"
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()


class Halting:
    """A ledger whose stream of blocks stands still behind the verdict, though it says that there are more."""

    def __init__(self, contract):
        self._contract = contract
        self.go_on = asyncio.Event()

    def __getattr__(self, name):
        return getattr(self._contract, name)

    async def committed(self, start_block):
        async for block in self._contract.committed(start_block):
            yield block
            if any(each.name == "ProofDecided" for each in block.events):
                await self.go_on.wait()


async def test_no_door_is_open_by_a_verdict_whose_end_has_not_been_read_yet(world):
    halting = []

    def halt(contract):
        halting.append(Halting(contract))
        return halting[-1]

    async with router() as where, rmf(where) as seen:
        async with world.pad(), world.uav() as uav:
            assert (await decided(uav)).verdict.permission == "granted"
        async with pad_node(world, where, open_rmf=DOOR, ledger=halt) as pad:
            pad.report(world.clock(), telemetry.Health())
            await asyncio.sleep(4.5)
            assert pad._reporting() is not None
            assert seen.modes == [OFFLINE]
            halting[0].go_on.set()
            await seen.stands(CLOSED)
            assert OPEN not in seen.modes


class Supervisor:
    """RMF's door supervisor, as it was read: passes on what adapters want, and reminds a door at each of its states."""

    def __init__(self, node):
        self._node = node
        self._wanted = set()
        self.reminders = 0
        self._say = node.advertise("/door_requests", TYPES.message(REQUEST))
        node.subscribe("/adapter_door_requests", self._asked, kind=TYPES.message(REQUEST), history=False)
        node.subscribe("/door_states", self._stated, kind=TYPES.message(STATE), history=False, depth=1_000)

    async def _asked(self, arrived):
        asked = TYPES.message(REQUEST).codec.decode(arrived.data)
        if asked.requested_mode.value == OPEN:
            self._wanted.add(asked.requester_id)
            await self._send(OPEN)
        elif asked.requester_id in self._wanted:
            self._wanted.discard(asked.requester_id)
            if not self._wanted:
                await self._send(CLOSED)

    async def _stated(self, arrived):
        mode = TYPES.message(STATE).codec.decode(arrived.data).current_mode.value
        if mode not in {OPEN if self._wanted else CLOSED, OFFLINE}:
            self.reminders += 1
            await self._send(OPEN if self._wanted else CLOSED)

    async def _send(self, mode):
        await self._say.publish(
            {"requester_id": "door_supervisor", "door_name": "pad-1", "requested_mode": {"value": mode}}
        )


async def test_rmfs_supervisor_and_the_pad_agree_and_do_not_answer_each_other_without_end(world):
    go, act = hold()
    async with (
        router() as where,
        rmf(where) as seen,
        Node("/door_supervisor", where.link) as other,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav(act=act) as uav,
    ):
        supervisor = Supervisor(other)
        await seen.stands(CLOSED)
        # Nobody of RMF's wants it: the supervisor asks to close what a proof has opened.
        proof = asyncio.create_task(decided(uav))
        await seen.stands(OPEN, 20)
        reminders, states = supervisor.reminders, len(seen.heard["/door_states"])
        await asyncio.sleep(3.0)
        assert supervisor.reminders > reminders
        assert len(seen.heard["/door_states"]) - states < 6, "a state a second, whatever is asked"
        assert seen.modes[-1] == OPEN
        go.set()
        assert (await proof).verdict.permission == "granted"
        await seen.stands(CLOSED)
        # A robot wants it, and says so once: the supervisor goes on asking until the robot takes it back.
        await seen.ask(by="fleet/robot", topic="/adapter_door_requests")
        await seen.stands(MOVING)
        await seen.until(
            lambda: seen.door()[1]["asked_for_by"] in {"fleet/robot, door_supervisor", "door_supervisor, fleet/robot"}
        )
        await seen.ask(CLOSED, by="fleet/robot", topic="/adapter_door_requests")
        await seen.stands(CLOSED)


async def test_who_has_rmfs_lock_is_shown_and_hinders_nobody(world):
    async with (
        router() as where,
        rmf(where) as seen,
        pad_node(world, where, open_rmf=DOOR),
        world.pad(local_reports="reports.sock"),
        world.uav() as uav,
    ):
        await seen.stands(CLOSED)
        kept = Qos(transient_local=True, depth=100)
        assigned = [{"group": "roof", "claimant": 7}, {"group": "other", "claimant": 8}]
        await seen.say("/mutex_group_states", GROUPS, kept, assignments=assigned)
        await seen.until(lambda: seen.door()[1]["mutex_group_held_by"] == "7")
        assert (await decided(uav)).verdict.permission == "granted"
        assert OPEN in seen.modes
