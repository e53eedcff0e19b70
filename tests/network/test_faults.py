"""kill −9 of each kind of server under a load of proofs: nothing lost, nothing done twice, no permission unfounded.

The longer version with both kinds of consensus, which measures, is tests/bench/test_faults.py.
"""

import asyncio
import sqlite3

import pytest
from kit.fault_load import audit, faulty, kill, proofs_after
from kit.listening import Listener

from wonderland_fabric_gateway.checkpoints import Checkpoint, MemoryCheckpointer
from wonderland_fabric_gateway.gateway import Deadlines, Gateway, UnknownTransactionError
from wonderland_fabric_network import bringing_up, keeping
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.leadership import is_leader

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(240)]

DESCRIPTION = NetworkDescription.parse(
    {
        "organisations": [
            {"msp_id": "AuthorityMSP", "kind": "authority", "peers": 2},
            {"msp_id": "PadMSP", "kind": "pads", "peers": 2},
            {"msp_id": "FleetMSP", "kind": "fleet"},
        ],
        "ordering": {"organisations": [{"msp_id": "OrdererMSP", "orderers": 3}]},
    }
)


@pytest.fixture(scope="module")
def network_of_many(fabric, network_class, tmp_path_factory):
    """Three orderers, and two peers of the organisations that endorse."""
    network = network_class.start(tmp_path_factory.mktemp("faults") / "net", DESCRIPTION)
    yield network
    network.down()


@pytest.fixture
def robust(network_of_many):
    """All of it up: what an earlier test killed and did not come to bring up again says nothing about this one."""
    network_of_many.up()
    return network_of_many


async def leader(network):
    """The orderer that leads."""
    async with asyncio.timeout(60):
        while True:
            for member in network.orderers:
                if network.processes.pid(member.component) is not None and await is_leader(
                    network.address(member, "operations"), network.channel
                ):
                    return member.component
            await asyncio.sleep(0.1)


def quiet(_step, _text):
    """Nobody listens."""


async def test_whatever_is_killed_nothing_is_lost_or_done_twice(robust, tmp_path):
    """One after the other, each restarted before the next: the orderers' leader, a peer of each endorsing
    organisation, a contract server, a CA."""
    network = robust.network
    async with faulty(network, tmp_path, 4_000) as (load, listeners, prepared):
        running = asyncio.create_task(load.run(prepared, at_once=4))
        try:
            await proofs_after(load.account, 5)
            victims = [await leader(network), "PadMSP.peer0", "AuthorityMSP.peer0", "PadMSP.contract-a", "PadMSP.ca"]
            for victim in victims:
                await kill(network, victim)
                if not victim.endswith("contract-a"):  # without one of the contracts nothing can be endorsed
                    await proofs_after(load.account, 5)
                await bringing_up.bring_up(network, robust.binaries, quiet)
                await proofs_after(load.account, 5)
        except BaseException:
            running.cancel()
            raise
        load.stop()
        await running
        await listeners.reach(await load.last())
    found = audit(load.account, listeners.blocks)
    assert (found.lost, found.duplicated, found.unresolved, found.unfounded) == (0, 0, 0, 0), found
    assert load.account.invalid == set()
    assert load.account.unknown == set()
    assert len(load.account.granted) == len(load.account.proofs_s)
    heard = [(tx_id, name) for _, tx_id, name in listeners.events if name == "ProofDecided"]
    assert len(heard) == len(set(heard)) == sum(each == "SubmitProof" for each in load.account.valid.values())
    assert [block.number for block in listeners.blocks] == list(
        range(listeners.blocks[0].number, listeners.blocks[-1].number + 1)
    )
    rows = sqlite3.connect(tmp_path / "mirror.db")
    assert rows.execute("SELECT count(*) FROM verdicts").fetchone() == (len(load.account.proofs_s),)
    rows.close()


async def test_a_listener_goes_on_over_kill_9_of_itself_its_peer_and_the_leading_orderer(robust, tmp_path):
    network = robust.network
    organisation = network.directory.organisation("PadMSP")
    listener = Listener(organisation.connection_file, "pad_operator", tmp_path / "events.db")
    told = []

    async def register(count):
        told.extend([(await robust.register_pad("pad_operator", "PadMSP")).tx_id for _ in range(count)])

    await listener.start()
    try:
        await register(3)
        await listener.kill()
        await register(3)  # while nobody listens
        await listener.start()
        await kill(network, "PadMSP.peer0")  # whose stream it is
        await register(3)
        await kill(network, await leader(network))
        await register(3)
        await listener.kill()  # it comes back to peers of which one is gone
        await register(1)
        await listener.start()
        await bringing_up.bring_up(network, robust.binaries, quiet)
        await register(3)
        await listener.reach(told[-1])
    finally:
        await listener.kill()
    heard = [tx_id for _, tx_id, name in listener.rows() if name == "PadRegistered"]
    assert heard[-len(told) :] == told
    assert len(set(heard)) == len(heard)
    blocks = [block for block, _, _ in listener.rows()]
    assert blocks == sorted(blocks)


async def test_a_checkpoint_of_another_network_is_said_before_anything_is_heard(robust):
    """Fabric itself would stay silent for ever."""
    done = await robust.register_pad()
    async with robust.mirror() as network:
        height = await network.height()
        for checkpoint, says in (
            (Checkpoint(done.block_number, "f" * 64), f"block {done.block_number} does not hold it"),
            (Checkpoint(height - 1, done.tx_id[::-1]), "does not hold it"),
        ):
            keeper = MemoryCheckpointer()
            keeper.save(checkpoint)
            with pytest.raises(UnknownTransactionError, match=says) as caught:
                await network.chaincode_events("pol", checkpointer=keeper, reconnect=True)
            assert "Remove the checkpoint to begin anew" in str(caught.value)


async def test_a_checkpoint_beyond_the_chain_is_waited_for_a_while_and_then_said(robust):
    connection = robust.connection
    async with connection.open_channel() as channel:
        limits = Deadlines(catch_up_s=1.0)
        gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"), deadlines=limits)
        network = gateway.network(connection.channel)
        beyond = await network.height() + 5
        for stream in (
            lambda keeper: network.chaincode_events("pol", checkpointer=keeper, reconnect=True),
            lambda keeper: network.blocks(checkpointer=keeper, reconnect=True),
        ):
            keeper = MemoryCheckpointer()
            keeper.save(Checkpoint(beyond))
            with pytest.raises(UnknownTransactionError, match=f"continues at block {beyond}.*gets no more"):
                await stream(keeper)


async def test_what_ends_is_brought_up_again(robust):
    """`wonderland network keep`."""
    network, said, stop = robust.network, [], asyncio.Event()
    keeper = asyncio.create_task(
        keeping.keep_up(network.directory, robust.binaries, lambda _step, text: said.append(text), stop)
    )
    try:
        for victim in ("PadMSP.contract-a", "OrdererMSP.orderer1"):
            await kill(network, victim)
            async with asyncio.timeout(60):
                while f"{victim} up again" not in said:
                    assert not keeper.done()
                    await asyncio.sleep(0.05)
            assert keeping.ended(network) == []
    finally:
        stop.set()
        await keeper
    await robust.register_pad()
