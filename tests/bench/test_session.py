"""A whole session beside what it cannot do without: two commits by the official client, and its time on the air."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from bench.bench_fabric import needs_fabric
from bench.bench_sessions import sessions
from bench.bench_steps import write_steps
from bench.bench_tools import p50, p95, show

from wonderland.proofs import encoding
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.transactions import SubmitProof
from wonderland.uwb.layout import STEPS_MS, RangingPlan, steps_ms
from wonderland.uwb.link.segments import MAX_TEXT_OCTETS
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fira_uci.uci.airtime import slot_us
from wonderland_fira_uci.uci.config import least_slots

SESSIONS = 24
COMMITS = 6
SIGNATURE_OCTETS = 64

pytestmark = [pytest.mark.bench, pytest.mark.node]


def airtime_ms(rounds, plan):
    """What the radio needs, in parts: nothing is lost, nobody thinks.

    A word waits half a block on average, and nodes hand it over when its round is over. Sessions' blocks differ in length.

    Poll, reply, the rounds, the ranges that were not told meanwhile, the last claim and the countersignature: a block
    has one round and carries one frame each way. Identities, claims, challenge and echo travel while it ranges.
    """
    block_ms = plan.interval_ms - steps_ms(plan.session_a_id) + (STEPS_MS - 1) / 2
    word_ms = block_ms / 2 + (least_slots(len(plan.pad_macs)) * slot_us(plan.slot_duration_rstu) / 1_000)
    signature = -(-(1 + SIGNATURE_OCTETS) // MAX_TEXT_OCTETS)
    return {
        "poll": word_ms,
        "reply": word_ms,
        "rounds": rounds * block_ms,
        "ranges told": word_ms,
        "claim and countersignature": word_ms + signature * block_ms,
    }


@pytest.mark.timeout(600)
@pytest.mark.parametrize("ledger", ["embedded", pytest.param("fabric", marks=pytest.mark.fabric)])
async def test_request_to_verdict(tmp_path, node_client, keep, ledger):
    if ledger == "fabric":
        needs_fabric()
    plan = RangingPlan(session_a_id=2, session_b_id=3, pad_macs=(1, 2, 3, 4), uav_mac=9, sts_key=bytes(16))
    walls, floors, commits, parts = [], [], [], {}
    steps_of = []
    async with sessions(tmp_path, policy=Policy(min_assurance=2), ledger=ledger) as proving:
        connection = proving.stage.connection
        home = SimpleNamespace(ready={"connection": str(proving.stage.connection_file)})
        node = await node_client(home, "pad_operator")
        await node.submit("CreateAsset", assets("warm", 20))
        await proving.prove()
        results = []
        for number in range(SESSIONS):
            results.append(await proving.prove())
            commits += await node.submit("CreateAsset", assets(f"n{number}", COMMITS))
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
            network = gateway.network(connection.channel)
            evidence = await submitted(network)
            contract = network.contract(connection.chaincode)
            for result in results:
                session = encoding.decode(
                    await contract.evaluate("ReadSession", encoding.encode({"session_id": result.session_id}))
                )
                brought = evidence[result.session_id]
                steps = {each.step: each.t_ms for each in brought.steps}
                verdict_ms = result.steps["verdict"]
                walls.append(verdict_ms - session["requested_ms"])
                floors.append(sum(airtime_ms(result.verdict.rounds, plan).values()))
                times = {"request committed": result.steps["request"], **steps, "verdict committed": verdict_ms}
                del times["request"]
                since = session["requested_ms"]
                merged = {**result.steps, **{name: t_ms for name, t_ms in steps.items() if name != "request"}}
                steps_of.append({name: t_ms - since for name, t_ms in merged.items()})
                before = session["requested_ms"]
                for name in ("request committed", "poll", "match", "reply", "range", "confirm", "verdict committed"):
                    parts.setdefault(name, []).append(times[name] - before)
                    before = times[name]
    rounds = [result.verdict.rounds for result in results]
    floor_ms = 2 * p50(commits) + p50(floors)
    on_air = airtime_ms(p50(rounds), plan)
    data, figure = write_steps(tmp_path, ledger, steps_of)
    show(
        f"Request → committed verdict, {ledger} ledger, {SESSIONS} sessions of {min(rounds)}–{max(rounds)} rounds",
        ("what", "p50 ms", "p95 ms"),
        [
            ("whole session", p50(walls), p95(walls)),
            *((f"  … until {name}", p50(values), p95(values)) for name, values in parts.items()),
            ("floor", f"{floor_ms:.0f}", ""),
            ("  two commits by the Node client", f"{2 * p50(commits):.0f}", ""),
            *((f"  air: {name}", f"{value:.0f}", "") for name, value in on_air.items()),
            ("ratio (goal ≤ 1.25)", f"{p50(walls) / floor_ms:.2f}", ""),
        ],
    )
    print(f"the steps: {data}, {figure}")
    keep(ledger=ledger, session_p50_ms=p50(walls), floor_ms=floor_ms, ratio=p50(walls) / floor_ms)


def assets(prefix, count):
    return [
        encoding.encode(
            {"id": f"{prefix}-{n}", "type": "std_msgs/msg/String", "media_type": "text/plain", "value": "x"}
        )
        for n in range(count)
    ]


async def submitted(network):
    """The evidence of every session on the ledger."""
    found = {}
    height = await network.height()
    async with network.blocks(start_block=0) as stream:
        async for block in stream:
            for transaction in block.transactions:
                if transaction.is_valid and transaction.invocation and transaction.invocation.function == "SubmitProof":
                    argument = SubmitProof.decode(transaction.invocation.args[1])
                    found[argument.session_id] = argument.evidence
            if block.number == height - 1:
                return found
    return found
