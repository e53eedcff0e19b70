"""The bridge between real masters with real rospy nodes: topics of one become assets, and topics of the other."""

from __future__ import annotations

import pytest
from kit.ros1 import BridgeProcess, Master, Peer, need_ros, running_ledger, write_config

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


@pytest.fixture
async def master(tmp_path):
    need_ros()
    made = Master(tmp_path)
    await made.start()
    yield made
    await made.stop()


async def test_a_topic_goes_over_the_ledger_to_another_bridge(tmp_path, master):
    async with running_ledger(tmp_path / "ledger") as ledger:
        connection = tmp_path / "ledger" / "connection.json"
        body = '[[to_ledger]]\ntopic = "/fix"\n'
        outward = write_config(
            tmp_path / "a.toml", ledger=connection, master=master.uri, identity="uav", bridge="drone-a", body=body
        )
        body = '[[from_ledger]]\nsenders = ["*"]\n'
        inward = write_config(
            tmp_path / "b.toml", ledger=connection, master=master.uri, identity="pad", bridge="pad-b", body=body
        )
        first, second = await BridgeProcess.start(outward), await BridgeProcess.start(inward)
        peer = await Peer.start("peer", master)
        try:
            kind = "sensor_msgs/NavSatFix"
            await peer.asked("subscribe", topic="/ledger/drone_a/fix", type=kind)
            await peer.asked("advertise", topic="/fix", type=kind)
            await peer.asked("wait", topic="/fix")
            sent = [(await peer.asked("fill", topic="/fix", seed=seed))["hex"] for seed in range(5)]
            heard = [line["hex"] for line in await peer.until("message", count=5)]
            assert heard == sent
            assert ledger.chain.height > 1
        finally:
            await peer.stop()
            assert await first.stop() == 0, first.log.read_text()
            assert await second.stop() == 0, second.log.read_text()
