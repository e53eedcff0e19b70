"""A pad as a node of ROS 2: whole proofs on a real ledger, heard by a peer that is none of ours through a real router."""

from __future__ import annotations

import asyncio
import json
import math
import uuid

import pytest
from kit.agents import FRAME, decided
from kit.ros2 import TYPES, SdkPeer, pad_node, parts_of, router

from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.node import Node
from wonderland_rmw_zenoh.standard import SERVICES

PAD = "/wonderland/pad_1"
VERDICT = "wonderland_msgs/msg/Verdict"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ACTION = f"{PAD}/prove_location/_action"


async def test_a_proof_is_heard_by_a_peer_that_is_none_of_ours(world):
    async with (
        router() as where,
        pad_node(world, where),
        world.pad(local_reports="reports.sock"),
        world.uav() as uav,
        SdkPeer.at(where) as peer,
    ):
        for name, kind in (("verdict", VERDICT), ("estimate", POSE), ("state", "wonderland_msgs/msg/PadState")):
            said = await peer.asked("subscribe", topic=f"{PAD}/{name}", **parts_of(kind))
            assert said["hash"] == TYPES.message(kind).hash, "two implementations of the type hash"
        await peer.asked("subscribe", topic=f"{PAD}/range/A1", **parts_of("sensor_msgs/msg/Range"))
        result = await decided(uav)
        assert result.verdict.outcome == "verified"
        heard = await peer.heard(f"{PAD}/verdict", fits=lambda found: found["session_id"] == result.session_id)
        assert (heard["outcome"], heard["permission"], heard["uav_id"]) == ("verified", "granted", result.uav_id)
        assert heard["tx_id"] == result.verdict_tx
        place, covariance = result.verdict.estimate, result.verdict.covariance
        position = heard["estimate"]["pose"]["position"]
        assert (position["x"], position["y"]) == (place.east_mm / 1000, place.north_mm / 1000)
        found = heard["estimate"]["covariance"]
        assert found[:2] == [covariance.ee_mm2 / 1e6, covariance.en_mm2 / 1e6]
        assert found[6:8] == [covariance.en_mm2 / 1e6, covariance.nn_mm2 / 1e6]
        running = await peer.heard(f"{PAD}/estimate")
        assert running["header"]["frame_id"] == "pad_1"
        assert (
            math.hypot(running["pose"]["pose"]["position"]["x"] - 4, running["pose"]["pose"]["position"]["y"] - 3) < 1
        )
        assert running["pose"]["covariance"][14] == 1e6, "the height is not measured"
        ranged = await peer.heard(f"{PAD}/range/A1")
        assert ranged["header"]["frame_id"] == "pad_1_A1"
        assert 3 < ranged["range"] < 9
        up = [{"up"}]  # as the nodes come to their feet, and as they are let go, some are not
        await peer.heard(
            f"{PAD}/state",
            fits=lambda found: found["reporting"] and [{each["state"] for each in found["anchors"]}] == up,
        )
        topics, info = {}, {"qos": []}
        async with asyncio.timeout(15):  # on a crowded machine its second of looking round does not see all
            while not {f"{PAD}/verdict", f"{ACTION}/feedback"} <= topics.keys():
                topics = dict(map(tuple, (await peer.asked("topics"))["topics"]))
            while not info["qos"]:
                info = await peer.asked("info", topic=f"{PAD}/verdict")
        assert topics[f"{PAD}/verdict"] == [VERDICT]
        assert topics[f"{ACTION}/feedback"] == ["wonderland_msgs/action/ProveLocation_FeedbackMessage"]
        assert info["qos"] == [":1:,1:,:,:,,"]
        assert info["nodes"] == ["pad_1"]


async def test_who_comes_late_gets_the_last_verdict_and_the_frames(world):
    async with router() as where:
        async with world.pad(), world.uav() as uav:
            result = await decided(uav)
        async with pad_node(world, where), Node("/late", where.link) as late:
            heard = {}

            async def take(arrived):
                heard[arrived.topic] = TYPES.of_hash(arrived.type, arrived.type_hash).codec.decode(arrived.data)

            names = (f"{PAD}/verdict", f"{PAD}/origin", "/tf_static", f"{PAD}/state")
            async with asyncio.timeout(10):
                while len(heard) < 2:  # published before the subscription
                    await asyncio.sleep(0.2)
                    for name in names:
                        late.subscribe(name, take)
                while set(heard) != set(names):
                    await asyncio.sleep(0.05)
        assert heard[names[0]].session_id == result.session_id
        origin = heard[names[1]]
        assert (round(origin.latitude * 1e7), round(origin.longitude * 1e7)) == (FRAME.lat_e7, FRAME.lon_e7)
        frames = {each.child_frame_id: each for each in heard["/tf_static"].transforms}
        assert frames["pad_1"].header.frame_id == "map"
        assert frames["pad_1_A2"].header.frame_id == "pad_1"
        place = frames["pad_1_A2"].transform.translation
        assert (place.x, place.y, place.z) == (-2.0, 2.0, 1.2)
        assert not heard[names[3]].reporting, "its agent is not there"


async def test_what_peers_publish_is_not_what_the_pad_says(world):
    """A liar publishes a verdict under the pad's own name, and tells the pad's socket things: the ledger has none."""
    async with router() as where, pad_node(world, where) as made, Node("/liar", where.link) as liar:
        lie = liar.advertise(f"{PAD}/verdict", TYPES.message(VERDICT), wire.STATE)
        await lie.publish({"pad_id": "pad-1", "outcome": "verified", "permission": "granted"})
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=str(world.directory / "reports.sock"), family=1
        )
        for datagram in (
            b"",
            b"{",
            b"\xff" * 100,
            json.dumps({"seq": 1, "kind": "verdict", "t_ms": 1, "body": {}}).encode(),
        ):
            transport.sendto(datagram)
        await asyncio.sleep(0.3)
        transport.close()
        assert made._action._server.open() == []
        assert made._told["reporting"] is False
        assert (world.directory / "reports.sock").stat().st_mode & 0o077 == 0


async def call(node, name, kind, **request):
    return await node.call(name, kind, request)


async def test_the_action_follows_a_proof_to_its_verdict(world):
    kind = TYPES.action("wonderland_msgs/action/ProveLocation")
    async with (
        router() as where,
        pad_node(world, where),
        world.pad(local_reports="reports.sock"),
        world.uav() as uav,
        Node("/client", where.link) as client,
    ):
        feedback = []

        async def take(arrived):
            assert arrived.type_hash == kind.feedback.hash
            feedback.append(kind.feedback.codec.decode(arrived.data).feedback)

        client.subscribe(f"{ACTION}/feedback", take, depth=1_000)
        await client.wait_for("SS", f"{ACTION}/get_result", 5)
        goal_id = {"uuid": list(uuid.uuid4().bytes)}
        other_id = {"uuid": list(uuid.uuid4().bytes)}
        goal = {"uav_id": uav.uav_id, "purpose": "land", "wait_s": 30.0}
        for bad in (
            {"purpose": "fly"},
            {"uav_id": ""},
            {"wait_s": math.nan},
            {"wait_s": -1.0},
            {"wait_s": 1e9},
            {"pad_id": "pad-2"},
        ):
            answer = await call(client, f"{ACTION}/send_goal", kind.send_goal, goal_id=other_id, goal=goal | bad)
            assert not answer.accepted, bad
        for each, more in ((goal_id, {}), (other_id, {"uav_id": "nobody", "wait_s": 1.0})):
            answer = await call(client, f"{ACTION}/send_goal", kind.send_goal, goal_id=each, goal=goal | more)
            assert answer.accepted
        assert not (await call(client, f"{ACTION}/send_goal", kind.send_goal, goal_id=goal_id, goal=goal)).accepted
        result = asyncio.create_task(call(client, f"{ACTION}/get_result", kind.get_result, goal_id=goal_id))
        proof = await uav.prove("pad-1", "land")
        found = await result
        assert found.result.session_id == proof.session_id
        assert found.result.outcome == proof.verdict.outcome
        assert found.result.tx_id == proof.verdict_tx
        assert found.status == (4 if proof.verdict.permission == "granted" else 6)
        async with asyncio.timeout(10):  # the result comes by another way than what was told on the way to it
            while not {"poll", "range"} <= {each.step for each in feedback}:
                await asyncio.sleep(0.05)
        assert max(each.rounds for each in feedback) > 0
        nobody = await call(client, f"{ACTION}/get_result", kind.get_result, goal_id=other_id)
        assert (nobody.status, nobody.result.reason, nobody.result.outcome) == (6, "not_requested", "")
        ended = await call(client, f"{ACTION}/cancel_goal", kind.cancel, goal_info={"goal_id": goal_id})
        assert ended.return_code == 3
        unknown = {"uuid": [7] * 16}
        assert (await call(client, f"{ACTION}/get_result", kind.get_result, goal_id=unknown)).status == 0
        assert (
            await call(client, f"{ACTION}/cancel_goal", kind.cancel, goal_info={"goal_id": unknown})
        ).return_code == 2


async def test_parameters_are_read_and_not_set(world):
    async with router() as where, pad_node(world, where), SdkPeer.at(where) as peer, Node("/us", where.link) as us:

        def service(name):
            return TYPES.service(f"rcl_interfaces/srv/{name}")

        await us.wait_for("SS", f"{PAD}/set_parameters_atomically", 5)
        names = await us.call(f"{PAD}/list_parameters", service("ListParameters"), {})
        assert "origin.latitude" in names.result.names
        values = await us.call(f"{PAD}/get_parameters", service("GetParameters"), {"names": ["pad_id", "no_such"]})
        assert [(each.type, each.string_value) for each in values.values] == [(4, "pad-1"), (0, "")]
        wish = {"parameters": [{"name": "pad_id", "value": {"type": 4, "string_value": "pad-2"}}]}
        answer = await us.call(f"{PAD}/set_parameters", service("SetParameters"), wish)
        assert not answer.results[0].successful
        state = await us.call(f"{PAD}/get_state", TYPES.service("lifecycle_msgs/srv/GetState"), {})
        assert state.current_state.label == "inactive"
        services = {}
        async with asyncio.timeout(15):
            while f"{PAD}/get_parameters" not in services:  # its session links with the others by and by
                services = dict(map(tuple, (await peer.asked("services"))["services"]))
        assert services[f"{PAD}/get_parameters"] == ["rcl_interfaces/srv/GetParameters"]
        request, response = SERVICES["rcl_interfaces/srv/GetParameterTypes"].split("---\n")
        called = {"service": f"{PAD}/get_parameter_types", "type": "rcl_interfaces/srv/GetParameterTypes", "parts": {}}
        found = await peer.asked("call", **called, request=request, response=response, arguments={"names": ["pad_id"]})
        assert found["answer"] == {"types": [4]}


@pytest.mark.timeout(60)
async def test_a_router_that_is_killed_is_found_again_and_the_ledger_is_followed_meanwhile(world):
    async with router() as where, pad_node(world, where), world.pad(), world.uav() as uav:
        await where.stop()
        result = await decided(uav)
        async with router(where.port), Node("/late", where.link) as late:
            heard = asyncio.Queue()
            late.subscribe(f"{PAD}/verdict", heard.put)
            async with asyncio.timeout(30):
                arrived = await heard.get()
        verdict = TYPES.message(VERDICT).codec.decode(arrived.data)
        assert verdict.session_id == result.session_id


@pytest.mark.timeout(90)
async def test_a_ledger_that_is_away_is_said_and_its_verdicts_come_when_it_is_back(world):
    async with router() as where, pad_node(world, where) as made, Node("/us", where.link) as us:
        states, verdicts = [], asyncio.Queue()

        async def take(arrived):
            states.append(TYPES.of_hash(arrived.type, arrived.type_hash).codec.decode(arrived.data).on_ledger)

        us.subscribe(f"{PAD}/state", take)
        us.subscribe(f"{PAD}/verdict", verdicts.put)
        async with asyncio.timeout(60):
            while not (states and states[-1]):
                await asyncio.sleep(0.1)
            await world.restart_ledger(8.0)
            assert False in states, "it was away for eight seconds"
            while not states[-1]:
                await asyncio.sleep(0.1)
            async with world.pad(), world.uav() as uav:
                result = await decided(uav)
            while True:
                arrived = await verdicts.get()
                if TYPES.message(VERDICT).codec.decode(arrived.data).session_id == result.session_id:
                    break
        assert made.placed.is_set()
