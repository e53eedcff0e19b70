"""kill −9 of each kind of server under a load of proofs: how long proofs stall, and what the chain says afterwards.

Everything is on this machine: the senders, five peers, the orderers, two contract servers, four CAs. A stall is the
longest time without a new verdict, from the kill (or the restart) until ten further proofs are decided; beside it stands
the same without any fault. Nothing is prepared but ranges and prekeys.
"""

from __future__ import annotations

import asyncio
import os
import time

import pytest
from bench.bench_tools import show
from kit.fault_load import audit, faulty, kill, proofs_after, stall_s

from wonderland_fabric_network import binaries, bringing_up, keeping, taking_down
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.errors import BinaryError
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.leadership import is_leader

AT_ONCE = 4
PROOFS = 20_000
PAUSE_S = 2.0
PATIENCE_S = 30.0
ROUNDS = int(os.environ.get("WONDERLAND_BENCH_FAULT_ROUNDS", "1"))

pytestmark = [pytest.mark.bench, pytest.mark.fabric, pytest.mark.timeout(900)]


def quiet(_step, _text):
    """Nobody listens."""


def description(consensus, orderers):
    return NetworkDescription.parse(
        {
            "organisations": [
                {"msp_id": "AuthorityMSP", "kind": "authority", "peers": 2},
                {"msp_id": "PadMSP", "kind": "pads", "peers": 2},
                {"msp_id": "FleetMSP", "kind": "fleet"},
            ],
            "ordering": {
                "consensus": consensus,
                "organisations": [{"msp_id": "OrdererMSP", "orderers": orderers}],
            },
        }
    )


async def leader(network):
    """The orderer that leads; of several that say so (one that just came back does) none, until they agree."""
    async with asyncio.timeout(60):
        while True:
            says = [
                member.component
                for member in network.orderers
                if network.processes.pid(member.component) is not None
                and await is_leader(network.address(member, "operations"), network.channel)
            ]
            if len(says) == 1:
                return says[0]
            await asyncio.sleep(0.1)


@pytest.mark.parametrize(("consensus", "orderers"), [("raft", 3), ("bft", 4)])
async def test_stalls(tmp_path, keep, consensus, orderers):
    try:
        servers = await binaries.check_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")
    network = bringing_up.new_network(NetworkDirectory(tmp_path / "net"), description(consensus, orderers))
    try:
        await bringing_up.bring_up(network, servers, quiet)
        rows, figures, account, found = await measured(network, servers, tmp_path)
    finally:
        await taking_down.take_down(network, quiet)
    show(
        f"{consensus}, {orderers} orderers: {len(account.proofs_s)} proofs, {AT_ONCE} at a time",
        ("killed", "stall s", "on restart s", "how it goes on"),
        rows,
    )
    show(
        "What the chain says of it",
        (
            "transactions acknowledged VALID",
            "lost",
            "done twice",
            "without an end",
            "unfounded permissions",
            "sent again",
        ),
        [
            (
                len(account.valid),
                found.lost,
                found.duplicated,
                len(account.unknown) + found.unresolved,
                found.unfounded,
                found.repeated_ids,
            )
        ],
    )
    keep(consensus=consensus, orderers=orderers, proofs=len(account.proofs_s), **figures)
    assert (found.lost, found.duplicated, found.unresolved, found.unfounded) == (0, 0, 0, 0)


async def measured(network, servers, directory):
    """Rows of the table, figures by name, the senders' account, and its audit."""
    rows, figures = [], {}
    async with faulty(network, directory, PROOFS) as (load, listeners, prepared):
        account = load.account
        running = asyncio.create_task(load.run(prepared, AT_ONCE))
        try:
            await proofs_after(account, 20)
            begin = time.monotonic()
            await asyncio.sleep(2 * PAUSE_S)
            rows.append(("nothing", f"{stall_s(account.proofs_s, begin, time.monotonic()):.2f}", "", ""))
            for _ in range(ROUNDS):
                for victim, name, way in (
                    ("", "leading orderer", "another one leads"),
                    ("", "leading orderer, again", "another one leads"),
                    ("PadMSP.peer0", "peer of the pads", "the organisation's other peer"),
                    ("AuthorityMSP.peer0", "peer of the authority", "the organisation's other peer"),
                    ("FleetMSP.peer0", "only peer of the fleet", "`network keep` starts it"),
                    ("PadMSP.contract-a", "only contract server", "`network keep` starts it"),
                    ("PadMSP.ca", "CA", "nobody needs it for a proof"),
                ):
                    component = victim or await leader(network)
                    stall, again = await one_fault(network, servers, account, component, kept="keep" in way)
                    rows.append((f"{name} ({component})", f"{stall:.2f}", f"{again:.2f}", way))
                    figures[name] = {"stall_s": round(stall, 2), "restart_s": round(again, 2)}
        except BaseException:
            running.cancel()
            raise
        load.stop()
        await running
        await listeners.reach(await load.last())
        found = audit(account, listeners.blocks)
        decided = [tx_id for _, tx_id, name in listeners.events if name == "ProofDecided"]
        assert len(decided) == len(set(decided)) == len(account.proofs_s)
    return rows, figures, account, found


async def one_fault(network, servers, account, victim, *, kept):
    """Stalls in seconds: after the kill, and after the restart."""
    stop = asyncio.Event()
    keeper = asyncio.create_task(keeping.keep_up(network.directory, servers, quiet, stop)) if kept else None
    begin = time.monotonic()
    try:
        await kill(network, victim)
        try:
            await proofs_after(account, 10, patience_s=PATIENCE_S)
        except TimeoutError:  # nothing takes its place: what `network keep` would have done at once
            await bringing_up.bring_up(network, servers, quiet)
            await proofs_after(account, 10)
        stall = stall_s(account.proofs_s, begin, time.monotonic())
    finally:
        stop.set()
        if keeper is not None:
            await keeper
    await asyncio.sleep(PAUSE_S)
    begin = time.monotonic()
    await bringing_up.bring_up(network, servers, quiet)
    await proofs_after(account, 10)
    again = stall_s(account.proofs_s, begin, time.monotonic())
    await asyncio.sleep(PAUSE_S)
    return stall, again
