"""A pad as a door before Open-RMF's own web server, unmodified: what it shows, and what its requests lead to."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager

import pytest
from kit.agents import decided
from kit.rmf_web import rmf_directory, rmf_web
from kit.ros2 import pad_node, router

from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node
from wonderland_rmw_zenoh.wire import Qos
from wonderland_ros_bridge.ros2.door import CLOSED, MOVING, OPEN
from wonderland_ros_bridge.ros2.settings import OpenRmfSettings

pytestmark = pytest.mark.timeout(180)
DOOR = OpenRmfSettings(mutex_group="roof")
STATE = "/doors/pad-1/state"
KEPT = Qos(transient_local=True, depth=10)
LANDING = {
    "type": "dispatch_task_request",
    "request": {
        "category": "compose",
        "unix_millis_earliest_start_time": 0,
        "description": {
            "category": "uav_land",
            "phases": [
                {
                    "activity": {
                        "category": "perform_action",
                        "description": {
                            "category": "uav_land",
                            "description": {"pad": "pad-1", "uav": "uav-1"},
                            "unix_millis_action_duration_estimate": 60_000,
                        },
                    }
                }
            ],
        },
    },
}


def mode(state):
    return state["current_mode"]["value"]


class Adapter:
    """What a fleet adapter does on the topics, and what RMF's map server says."""

    def __init__(self, node):
        rmf = rmf_directory()
        self.types = Interfaces([rmf / "rmf_internal_msgs", rmf / "rmf_building_map_msgs"])
        self.node = node
        self.orders = []
        self._made = {}
        node.subscribe("/task_api_requests", self._ordered, kind=self.types.message("rmf_task_msgs/msg/ApiRequest"))

    async def _ordered(self, arrived):
        asked = self.types.of_hash(arrived.type, arrived.type_hash).codec.decode(arrived.data)
        self.orders.append(json.loads(asked.json_msg))
        state = {"booking": {"id": "uav_land.1"}, "category": "uav_land", "status": "queued"}
        answer = {"type": 2, "request_id": asked.request_id, "json_msg": json.dumps({"success": True, "state": state})}
        await self.say("/task_api_responses", "rmf_task_msgs/msg/ApiResponse", KEPT, **answer)

    async def say(self, topic, kind, qos=None, **message):
        if topic not in self._made:
            self._made[topic] = self.node.advertise(topic, self.types.message(kind), qos)
            await asyncio.sleep(0.5)
        await self._made[topic].publish(message)

    async def lock(self, value):
        await self.say(
            "/mutex_group_request", "rmf_fleet_msgs/msg/MutexGroupRequest", KEPT, group="roof", claimant=3, mode=value
        )

    async def door(self, value):
        await self.say(
            "/adapter_door_requests",
            "rmf_door_msgs/msg/DoorRequest",
            requester_id="fleet/uav-1",
            door_name="pad-1",
            requested_mode={"value": value},
        )


@asynccontextmanager
async def everything(world, act=None):
    rmf_directory()
    async with (
        router() as where,
        rmf_web(where, world.directory) as web,
        Node("/fleet_adapter", where.link) as node,
        pad_node(world, where, open_rmf=DOOR) as pad,
        world.pad(local_reports="reports.sock"),
        world.uav(act=act) as uav,
    ):
        yield web, Adapter(node), pad, uav


async def seen(web, modes):
    """All that the server says of the door, until cancelled."""
    while True:
        found = mode(await web.get(STATE))
        if modes[-1:] != [found]:
            modes.append(found)
        await asyncio.sleep(0.02)


async def test_the_table_from_the_task_to_the_landing(world):
    go = asyncio.Event()

    async def act(_verdict):
        await go.wait()
        return "done"

    async with everything(world, act) as (web, adapter, pad, uav):
        door = {"name": "pad-1", "door_type": 1, "v2_x": 3.0}
        await adapter.say(
            "/map",
            "rmf_building_map_msgs/msg/BuildingMap",
            KEPT,
            name="harbour",
            levels=[{"name": "roof", "doors": [door]}],
        )
        doors = await web.until("/doors", lambda found: found)
        assert [each["name"] for each in doors] == ["pad-1"]
        await web.until(STATE, lambda found: mode(found) == CLOSED)
        modes = []
        watching = asyncio.create_task(seen(web, modes))
        # 1: a task, which RMF gives to an adapter.
        found = await web.post("/tasks/dispatch_task", LANDING)
        assert found["state"]["booking"]["id"] == "uav_land.1"
        assert adapter.orders[0]["request"]["description"]["category"] == "uav_land"
        # 2 and 3: the lock and the door, and from the dashboard, too. It opens by none of them.
        await adapter.lock(1)
        await adapter.door(OPEN)
        await web.post("/doors/pad-1/request", {"mode": OPEN})
        await web.until(STATE, lambda found: mode(found) == MOVING)
        async with asyncio.timeout(5):
            while set(pad._door._wishes.held(world.clock())) != {"fleet/uav-1", "rmf_api_server"}:
                await asyncio.sleep(0.02)
        await asyncio.sleep(1.5)
        assert modes == [CLOSED, MOVING]
        # 4 and 5a: the drone proves where it is; the ledger decides.
        proof = asyncio.create_task(decided(uav))
        await web.until(STATE, lambda found: mode(found) == OPEN, 30)
        queue = await web.until("/ingestors/pad-1/state", lambda found: found["request_guid_queue"])
        assert queue["request_guid_queue"][0].startswith("uav-1 land ")
        await web.post("/doors/pad-1/request", {"mode": CLOSED})
        await asyncio.sleep(1.2)
        assert modes[-1] == OPEN, "nor does RMF take a permission back"
        go.set()
        assert (await proof).verdict.permission == "granted"
        # 6: on the ground.
        await adapter.door(CLOSED)
        await adapter.lock(0)
        await web.until(STATE, lambda found: mode(found) == CLOSED)
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)
        assert [each for each in modes if each == OPEN] == [OPEN]
        assert await web.get("/alerts/unresponded_requests") == []


async def test_a_refusal_stays_closed_and_is_an_alert(world):
    world.flight.claimed = (40_000.0, 3_000.0, 6_000.0)
    async with everything(world) as (web, adapter, _, uav):
        await web.until(STATE, lambda found: mode(found) == CLOSED)
        modes = []
        watching = asyncio.create_task(seen(web, modes))
        await adapter.door(OPEN)
        result = await decided(uav)
        assert result.verdict.outcome == "refuted"
        alerts = await web.until("/alerts/unresponded_requests", lambda found: found)
        assert alerts[0] == await web.get(f"/alerts/request/{alerts[0]['id']}")
        assert alerts[0]["id"] == f"wonderland-{result.session_id}-refuted"
        assert alerts[0]["tier"] == "error"
        assert {"name": "tx_id", "value": result.verdict_tx} in alerts[0]["alert_parameters"]
        assert "claim" in alerts[0]["message"]
        await web.until(STATE, lambda found: mode(found) == CLOSED)
        await asyncio.sleep(1.2)
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)
        assert OPEN not in modes
        assert modes[-1] == CLOSED
        answered = await web.post(f"/alerts/request/{alerts[0]['id']}/respond?response=Seen", {}, 201)
        assert answered["response"] == "Seen"
        assert await web.get("/alerts/unresponded_requests") == []
        assert mode(await web.get(STATE)) == CLOSED
