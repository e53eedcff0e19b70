"""Topics of ROS 2 to a real ledger and back, with a peer that is none of ours on both ends."""

from __future__ import annotations

import asyncio
import json
import math
from contextlib import asynccontextmanager

import pytest
from click.testing import CliRunner
from kit.ros1 import running_ledger
from kit.ros2 import SdkPeer, parts_of, router

from wonderland.toml_settings import SettingsError
from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node
from wonderland_ros_bridge.ros2.commands import ros2
from wonderland_ros_bridge.ros2.run_command import opened
from wonderland_ros_bridge.ros2.settings import load

FIX = "sensor_msgs/msg/NavSatFix"
BACK = "/ledger/drone_a/fix"
TYPES = Interfaces()


def config(directory, where, name, identity, body):
    path = directory / f"{name}.toml"
    path.write_text(
        f'bridge = "{name}"\nspool = "{name}.spool"\n{body}\n'
        f'[ledger]\nconnection = "ledger/connection.json"\nidentity = "{identity}"\n'
        f'[ros2]\nconnect = ["{where.endpoint}"]\n'
    )
    return path


@asynccontextmanager
async def running(path):
    async with opened(load(path)) as parts:
        tasks = [asyncio.create_task(each.run()) for each in parts]
        try:
            async with asyncio.timeout(20):
                for each in parts:
                    await each.wait_placed()
            yield parts
        finally:
            for each in tasks:
                each.cancel()
            ended = await asyncio.gather(*tasks, return_exceptions=True)
            assert all(isinstance(each, asyncio.CancelledError) for each in ended), ended


@asynccontextmanager
async def route(tmp_path, to_ledger='topic = "/fix"', from_ledger='senders = ["*"]'):
    async with running_ledger(tmp_path / "ledger"), router() as where:
        outward = config(tmp_path, where, "drone-a", "uav", f"[[to_ledger]]\n{to_ledger}")
        inward = config(tmp_path, where, "pad-b", "pad", f"[[from_ledger]]\n{from_ledger}")
        async with running(outward), running(inward):
            yield where, outward


def wonderland(*arguments):
    done = CliRunner().invoke(ros2, [str(each) for each in arguments])
    return done.exit_code, done.output


async def until(condition, limit_s=15):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.05)


async def test_messages_go_to_the_ledger_and_come_back_byte_for_byte(tmp_path):
    async with route(tmp_path) as (where, outward), Node("/peer", where.link) as peer, SdkPeer.at(where) as other:
        heard = []

        async def take(arrived):
            heard.append((arrived.type_hash, arrived.data))

        peer.subscribe(BACK, take, depth=1_000)
        await other.asked("subscribe", topic=BACK, **parts_of(FIX))
        kind = TYPES.message(FIX)
        sends = peer.advertise("/fix", kind)
        await asyncio.sleep(0.5)
        sent = []
        for index in range(50):
            covariance = [float(index), math.nan, math.inf, *[0.0] * 6]
            sent.append(kind.codec.encode({"latitude": 60 + index / 7, "position_covariance": covariance}))
            await sends.publish_bytes(sent[-1])
        await until(lambda: len(heard) >= 50)
        assert heard == [(kind.hash, each) for each in sent], "each once, in order"
        found = await other.heard(BACK, fits=lambda one: one["position_covariance"][0] == 49.0)
        assert found["latitude"] == 60 + 49 / 7
        code, told = await asyncio.to_thread(wonderland, "read", "--config", outward, "/fix")
        assert code == 0, told
        shown = json.loads(told)
        assert shown["type"] == FIX
        assert shown["messages"][-1]["message"]["position_covariance"][1] == "nan"
        code, told = await asyncio.to_thread(wonderland, "status", "--config", outward)
        assert (code, "0 messages wait" in told) == (0, True), told


async def test_a_pattern_finds_topics_and_other_hashes_are_left_out(tmp_path, caplog):
    async with (
        route(tmp_path, 'topic = "/uav/*"\ntype = "std_msgs/msg/String"') as (where, _),
        Node("/peer", where.link) as peer,
    ):
        heard = []

        async def take(arrived):
            heard.append(
                (arrived.topic, TYPES.of_hash(arrived.type, arrived.type_hash).codec.decode(arrived.data).data)
            )

        peer.subscribe("/ledger/drone_a/uav/a", take)
        string = TYPES.message("std_msgs/msg/String")
        sends = peer.advertise("/uav/a", string, wire.STATE)
        await sends.publish({"data": "latched before anybody looked"})
        await until(lambda: heard)
        key = f"{wire.data_key(0, '/uav/a', string.name, string.hash)[:-64]}{'0' * 64}"
        beside = wire.Attachment(1, 1, b"g" * 16).encode()
        peer.session.put(key, string.codec.encode({"data": "lie"}), attachment=beside)
        number = TYPES.message("std_msgs/msg/Int8")
        peer.session.put(
            wire.data_key(0, "/uav/a", number.name, number.hash), number.codec.encode({}), attachment=beside
        )
        await sends.publish({"data": "true"})
        await until(lambda: len(heard) == 2)
        assert [text for _, text in heard] == ["latched before anybody looked", "true"]
        assert "type hash" in caplog.text
        assert "is wanted" in caplog.text


async def test_what_waits_goes_after_a_restart_of_the_bridge(tmp_path):
    async with running_ledger(tmp_path / "ledger"), router() as where, Node("/peer", where.link) as peer:
        outward = config(tmp_path, where, "drone-a", "uav", '[[to_ledger]]\ntopic = "/fix"')
        inward = config(tmp_path, where, "pad-b", "pad", 'from_start = true\n[[from_ledger]]\nsenders = ["*"]')
        kind = TYPES.message("std_msgs/msg/String")
        sends = peer.advertise("/fix", kind)
        for part in range(2):
            async with running(outward):
                await asyncio.sleep(1.0)
                for index in range(10):
                    await sends.publish({"data": f"{part}.{index}"})
                await asyncio.sleep(0.5)
        heard = []

        async def take(arrived):
            heard.append(kind.codec.decode(arrived.data).data)

        peer.subscribe(BACK, take, depth=100)
        async with running(inward):
            await until(lambda: len(heard) >= 20)
        assert heard == [f"{part}.{index}" for part in range(2) for index in range(10)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[ledger]\nconnection = "c"\nidentity = "i"\n', "nothing to do"),
        ('[ledger]\nconnection = "c"\nidentity = "i"\n[[to_ledger]]\ntopic = "/fix"\n', "bridge and spool"),
    ],
)
def test_settings_that_say_too_little(tmp_path, text, says):
    path = tmp_path / "ros2.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=says):
        load(path)
