"""A real rospy node's message over the ledger and back to it, beside a bare commit of the same value in the same run.

``WONDERLAND_ROS_LATENCY=FILE`` keeps the single times as JSON lines, from which ``scripts/ros_latency.py`` draws.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import time
from pathlib import Path

import pytest
from bench.bench_fabric import fabric_network
from bench.bench_tools import p50, p95, show
from kit.ros1 import BridgeProcess, Master, Peer, need_ros, write_config

from wonderland.asset_contract import AssetContract
from wonderland.proof_contract import RefusedError
from wonderland.proofs.records import transactions as tx
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_network import taking_down

PINGS, ROUNDS, FLOOD = 20, 5, 5_000
KIND = "sensor_msgs/NavSatFix"
pytestmark = [pytest.mark.bench, pytest.mark.timeout(600)]


@contextlib.asynccontextmanager
async def contract_of(connection, identity):
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity(identity), connection.signer(identity))
        yield AssetContract(gateway.network(connection.channel), connection.chaincode)


@contextlib.asynccontextmanager
async def bridges(tmp_path, connection_file, identity, *, batch=100):
    need_ros()
    master = Master(tmp_path)
    await master.start()
    common = {"ledger": connection_file, "master": master.uri, "identity": identity}
    outward = f'[[to_ledger]]\ntopic = "/fix"\nbatch_messages = {batch}\n'
    first = await BridgeProcess.start(write_config(tmp_path / "a.toml", **common, bridge="drone-a", body=outward))
    inward = '[[from_ledger]]\nsenders = ["*"]\nlatch = false\n'
    second = await BridgeProcess.start(write_config(tmp_path / "b.toml", **common, bridge="pad-b", body=inward))
    peer = await Peer.start("peer", master)
    try:
        await peer.asked("advertise", topic="/fix", type=KIND)
        await peer.asked("wait", topic="/fix")
        yield peer
    finally:
        for each in (peer, first, second, master):
            await each.stop()


async def bare_commits(contract, value, count):
    """Milliseconds from endorsing to VALID, of an asset that is changed again and again: what the bridge does."""
    took = []
    for _ in range(count):
        start = time.perf_counter()
        try:
            await contract.update_asset(tx.UpdateAsset(id="bare", value=value))
        except RefusedError:
            await contract.create_asset(
                tx.CreateAsset(id="bare", type=KIND, media_type="application/json", value=value)
            )
        took.append((time.perf_counter() - start) * 1e3)
    return took


async def seen_on_the_ledger(contract, times):
    """When the bench itself gets each block of the topic's asset."""
    async for block in contract.committed(await contract.height()):
        times += [
            time.time() for each in block.events if each.asset is not None and each.asset.id == "ros1/drone-a/fix"
        ]


async def until(seen, count):
    async with asyncio.timeout(10):
        while len(seen) < count:
            await asyncio.sleep(0.01)


async def measured(tmp_path, connection, connection_file, identity, what, keep):
    on_ledger, whole, valid, bare = [], [], [], []
    async with contextlib.AsyncExitStack() as stack:
        contract = await stack.enter_async_context(contract_of(connection, identity))
        peer = await stack.enter_async_context(bridges(tmp_path, connection_file, identity))
        watching = asyncio.create_task(seen_on_the_ledger(contract, on_ledger))
        stack.callback(watching.cancel)
        value = "x" * 600
        await bare_commits(contract, value, 5)
        order = {"topic": "/fix", "back": "/ledger/drone_a/fix"}
        await peer.asked("ping", **order, count=3, wait=False)
        await until(on_ledger, 3)
        for _ in range(ROUNDS):
            bare += await bare_commits(contract, value, PINGS)
            on_ledger.clear()
            times = (await peer.asked("ping", **order, count=PINGS, wait=True))["times"]
            whole += [(back - sent) * 1e3 for sent, back in times]
            await until(on_ledger, PINGS)
            valid += [(seen - sent) * 1e3 for seen, (sent, _) in zip(on_ledger, times, strict=True)]
        flood = await peer.asked("flood", **order, count=FLOOD, wait=True)
    rate = FLOOD / flood["back_s"]
    alone = 1e3 / p50(bare)
    rows = [
        ("bare commit of the same asset", f"{p50(bare):.1f}", f"{p95(bare):.1f}", "1.00 ×"),
        (
            "topic → block of its asset read",
            f"{p50(valid):.1f}",
            f"{p95(valid):.1f}",
            f"{p50(valid) / p50(bare):.2f} ×",
        ),
        ("topic → ledger → topic", f"{p50(whole):.1f}", f"{p95(whole):.1f}", f"{p50(whole) / p50(bare):.2f} ×"),
    ]
    show(f"ROS 1, {what}: ms, one message at a time ({len(whole)} each)", ("", "p50", "p95", "beside"), rows)
    print(
        f"  {FLOOD} messages at once: {rate:.0f} /s there and back ({flood['twice']} twice), {rate / alone:.1f} × bare commits one by one ({alone:.0f} /s)"
    )
    keep(
        what=what, bare_ms=p50(bare), valid_ms=p50(valid), whole_ms=p50(whole), messages_per_s=rate, commits_per_s=alone
    )
    assert flood["twice"] == 0
    if path := os.environ.get("WONDERLAND_ROS_LATENCY"):
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"what": what, "bare_ms": bare, "valid_ms": valid, "whole_ms": whole}) + "\n")


@pytest.mark.parametrize("batch_ms", [0, 10])
async def test_embedded(tmp_path, start_ledger, keep, batch_ms):
    need_ros()
    connection, ledger = await start_ledger("--batch-ms", str(batch_ms))
    await measured(
        tmp_path, connection, ledger.ready["connection"], "pad", f"embedded ledger, {batch_ms} ms batches", keep
    )


@pytest.mark.fabric
async def test_fabric(tmp_path, keep):
    need_ros()
    ordering = {"consensus": "raft", "organisations": [{"msp_id": "OrdererMSP", "orderers": 1}], "batch_timeout_ms": 20}
    network = await fabric_network(tmp_path / "net", ordering=ordering)
    try:
        file = network.directory.organisation("PadMSP").connection_file
        await measured(tmp_path, Connection.load(file), file, "pad", "Fabric, Raft, 20 ms batches", keep)
    finally:
        await taking_down.take_down(network, lambda *_: None)
