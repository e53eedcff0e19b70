"""Our Gateway client beside the official Node client, on the same ledger, in alternating blocks: embedded and Fabric."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
from bench.bench_fabric import fabric_network
from bench.bench_tools import p50, p95, show

from wonderland.proofs import encoding
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_network import taking_down

BLOCKS = 12
PER_BLOCK = 40
WARM_UP = 40
FABRIC_BLOCKS = 8
PER_BLOCK_FABRIC = 20

pytestmark = [pytest.mark.bench, pytest.mark.node]


def assets(prefix, count):
    return [
        encoding.encode(
            {"id": f"{prefix}-{index}", "type": "std_msgs/msg/String", "media_type": "text/plain", "value": "x" * 200}
        )
        for index in range(count)
    ]


async def ours(contract, arguments):
    took = []
    for argument in arguments:
        start = time.perf_counter()
        await contract.submit("CreateAsset", argument)
        took.append((time.perf_counter() - start) * 1e3)
    return took


@pytest.mark.parametrize("batch_ms", [10, 0])
async def test_endorse_to_valid(start_ledger, node_client, keep, batch_ms):
    connection, ledger = await start_ledger("--batch-ms", str(batch_ms))
    node = await node_client(ledger, "pad")
    await compared(connection, node, keep, f"embedded ledger, batch time {batch_ms} ms", BLOCKS, PER_BLOCK)


@pytest.mark.fabric
@pytest.mark.timeout(600)
@pytest.mark.parametrize("batch_ms", [10, 20, 100])
@pytest.mark.parametrize(("consensus", "orderers"), [("raft", 1), ("bft", 4)])
async def test_endorse_to_valid_on_fabric(tmp_path, node_client, keep, consensus, orderers, batch_ms):
    """Both clients use the same peer, one after the other."""
    network = await fabric_network(
        tmp_path / "net",
        ordering={
            "consensus": consensus,
            "organisations": [{"msp_id": "OrdererMSP", "orderers": orderers}],
            "batch_timeout_ms": batch_ms,
        },
    )
    try:
        file = network.directory.organisation("PadMSP").connection_file
        node = await node_client(SimpleNamespace(ready={"connection": str(file)}), "pad")
        what = f"Fabric, {consensus}, {orderers} orderers, batch time {batch_ms} ms"
        await compared(Connection.load(file), node, keep, what, FABRIC_BLOCKS, PER_BLOCK_FABRIC)
    finally:
        await taking_down.take_down(network, lambda *_: None)


async def compared(connection, node, keep, what, blocks, per_block):
    """Alternating blocks of transactions by either client; prints the table."""
    mine, theirs = [], []
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
        contract = gateway.network(connection.channel).contract(connection.chaincode)
        await ours(contract, assets("warm-ours", WARM_UP))
        await node.submit("CreateAsset", assets("warm-node", WARM_UP))
        for block in range(blocks):
            mine += await ours(contract, assets(f"ours-{block}", per_block))
            theirs += await node.submit("CreateAsset", assets(f"node-{block}", per_block))
        for name in (f"ours-{blocks - 1}-{per_block - 1}", f"node-{blocks - 1}-{per_block - 1}"):
            read = encoding.decode(await contract.evaluate("ReadAsset", encoding.encode({"id": name})))
            assert read["value"] == "x" * 200
    show(
        f"Endorse → VALID of CreateAsset, one after the other, {what}",
        ("client", "n", "p50 ms", "p95 ms"),
        [
            ("@hyperledger/fabric-gateway (Node)", len(theirs), f"{p50(theirs):.2f}", f"{p95(theirs):.2f}"),
            ("wonderland_fabric_gateway.gateway", len(mine), f"{p50(mine):.2f}", f"{p95(mine):.2f}"),
            ("ratio (goal ≤ 1.00)", "", f"{p50(mine) / p50(theirs):.2f}", f"{p95(mine) / p95(theirs):.2f}"),
        ],
    )
    keep(what=what, ours_p50_ms=p50(mine), node_p50_ms=p50(theirs), ratio_p50=p50(mine) / p50(theirs))
