"""`wonderland ros2 router`: nodes meet at it; a node that meets nobody says so, and so it says when it does again."""

from __future__ import annotations

import asyncio
import sys

import pytest
from click.testing import CliRunner
from kit.ros2 import TYPES, free_port

from wonderland_rmw_zenoh.node import Node
from wonderland_rmw_zenoh.session import Link
from wonderland_ros_bridge.ros2 import run_command
from wonderland_ros_bridge.ros2.commands import ros2

TEXT = "std_msgs/msg/String"


async def until(condition, limit_s=20):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.05)


async def test_nodes_meet_at_it_and_who_meets_nobody_says_so(monkeypatch, caplog):
    monkeypatch.setattr(run_command, "COMPANY_S", 0.1)
    caplog.set_level("INFO")
    where = f"tcp/127.0.0.1:{free_port()}"
    async with Node("/one", Link(connect=(where,))) as one, run_command._told_who_is_missing(one, where):
        await until(lambda: f"no router and no peer of ROS 2 is reached at {where}" in caplog.text)
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "wonderland.cli", "ros2", "router", "--listen", where),
            stdout=asyncio.subprocess.PIPE,
        )
        try:
            assert f"A router at {where}" in (await process.stdout.readline()).decode()
            await until(lambda: "is reached again" in caplog.text)
            async with Node("/two", Link(connect=(where,))) as two:
                heard = asyncio.Queue()
                kind = TYPES.message(TEXT)
                two.subscribe("/words", heard.put)
                said = one.advertise("/words", kind)
                await until(lambda: two.endpoints("MP", "/words"))
                await said.publish({"data": "hello"})
                async with asyncio.timeout(10):
                    assert kind.codec.decode((await heard.get()).data).data == "hello"
        finally:
            process.terminate()
            assert await asyncio.wait_for(process.wait(), 10) == 0


@pytest.mark.parametrize("where", ["tcp/0.0.0.0:7447", "tls/127.0.0.1:7447", "7447"])
def test_it_serves_this_machine_alone(where):
    result = CliRunner().invoke(ros2, ["router", "--listen", where])
    assert result.exit_code == 1
    assert "listen: " in result.output
