"""Our Gateway client beside the official Node client, on the same embedded ledger, in alternating blocks."""

from __future__ import annotations

import time

import pytest
from bench_tools import p50, p95, show

from wonderland.ledger.gateway import Gateway
from wonderland.proofs import encoding

BLOCKS = 12
PER_BLOCK = 40
WARM_UP = 40

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
    mine, theirs = [], []
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
        contract = gateway.network(connection.channel).contract(connection.chaincode)
        await ours(contract, assets("warm-ours", WARM_UP))
        await node.submit("CreateAsset", assets("warm-node", WARM_UP))
        for block in range(BLOCKS):
            mine += await ours(contract, assets(f"ours-{block}", PER_BLOCK))
            theirs += await node.submit("CreateAsset", assets(f"node-{block}", PER_BLOCK))
        for name in (f"ours-{BLOCKS - 1}-{PER_BLOCK - 1}", f"node-{BLOCKS - 1}-{PER_BLOCK - 1}"):
            read = encoding.decode(await contract.evaluate("ReadAsset", encoding.encode({"id": name})))
            assert read["value"] == "x" * 200
    show(
        f"Endorse → VALID of CreateAsset, one after the other, batch time {batch_ms} ms",
        ("client", "n", "p50 ms", "p95 ms"),
        [
            ("@hyperledger/fabric-gateway (Node)", len(theirs), f"{p50(theirs):.2f}", f"{p95(theirs):.2f}"),
            ("wonderland.ledger.gateway", len(mine), f"{p50(mine):.2f}", f"{p95(mine):.2f}"),
            ("ratio (goal ≤ 1.00)", "", f"{p50(mine) / p50(theirs):.2f}", f"{p95(mine) / p95(theirs):.2f}"),
        ],
    )
    keep(batch_ms=batch_ms, ours_p50_ms=p50(mine), node_p50_ms=p50(theirs), ratio_p50=p50(mine) / p50(theirs))
