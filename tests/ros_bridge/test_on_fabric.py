"""Two organisations' bridges on a real Fabric network, with real rospy on both ends, and everything of Fabric killed."""

from __future__ import annotations

import asyncio

import pytest
from kit.ros1 import BridgeProcess, Master, Peer, need_ros, write_config
from kit.scenario_world import FabricPlace

from wonderland_fabric_network import binaries
from wonderland_fabric_network.errors import BinaryError

FIX = "sensor_msgs/NavSatFix"


@pytest.mark.fabric
@pytest.mark.timeout(180)
async def test_messages_come_over_fabric_through_a_kill_of_all_of_it(tmp_path):
    need_ros()
    try:
        binaries.find_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")
    place = FabricPlace(tmp_path)
    running = []
    await asyncio.to_thread(place.start)
    try:
        master = Master(tmp_path)
        running.append(master)
        await master.start()

        def config(bridge, msp_id, identity, body):
            ledger = place.directory.organisation(msp_id).connection_file
            path = tmp_path / f"{bridge}.toml"
            return write_config(path, ledger=ledger, master=master.uri, identity=identity, bridge=bridge, body=body)

        outward = config("drone-a", "FleetMSP", "uav", '[[to_ledger]]\ntopic = "/fix"\nbatch_messages = 7\n')
        inward = config("pad-b", "PadMSP", "pad", '[[from_ledger]]\nsenders = ["FleetMSP/uav"]\n')
        running += [await BridgeProcess.start(outward), await BridgeProcess.start(inward)]
        peer = await Peer.start("peer", master)
        running.append(peer)
        await peer.asked("subscribe", topic="/ledger/drone_a/fix", type=FIX)
        await peer.asked("advertise", topic="/fix", type=FIX)
        await peer.asked("wait", topic="/fix")
        sent = [(await peer.asked("fill", topic="/fix", seed=seed))["hex"] for seed in range(50)]
        assert [line["hex"] for line in await peer.until("message", count=50)] == sent

        sent = [(await peer.asked("fill", topic="/fix", seed=seed))["hex"] for seed in range(50, 250)]
        await asyncio.to_thread(place.crash)
        sent += [(await peer.asked("fill", topic="/fix", seed=seed))["hex"] for seed in range(250, 300)]
        heard = [line["hex"] for line in await peer.until("message", count=250)]
        assert heard == sent, "each once, in order"
    finally:
        for each in reversed(running):
            await each.stop()
        await asyncio.to_thread(place.stop)
