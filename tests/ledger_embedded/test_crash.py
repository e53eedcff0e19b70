"""kill −9, and a power cut: what a client was told is there afterwards, and nothing by halves."""

import asyncio
import random
import signal
import subprocess
import sys

import pytest
from kit import environment

from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.integrity import verify_tip
from wonderland_fabric_gateway.embedded.state import StateReader
from wonderland_fabric_gateway.gateway import Gateway, GatewayError

SERVER = ["-m", "kit.ledger_process"]


def start(directory, listen="127.0.0.1:0"):
    process = subprocess.Popen(
        [sys.executable, *SERVER, directory, listen],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    address = process.stdout.readline().strip()
    if not address:
        pytest.fail(f"the ledger did not start: {process.communicate(timeout=10)[1]}")
    return process, address


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=10)


async def write_until_struck(outage, directory, process, told, after_s, round_):
    """Submit from eight clients at once until the ledger is gone; `told` collects what was said to be committed."""
    connection = Connection.load(directory)
    async with connection.open_channel() as channel:
        contract = (
            Gateway(channel, connection.identity("pad"), connection.signer("pad")).network("wonderland").contract("pol")
        )

        async def client(number):
            for index in range(100_000):
                key, value = f"{round_}/{number}/{index}", f"value {index}"
                try:
                    commit = await (await contract.propose("put", key, value).endorse()).submit()
                    status = await commit.status()
                except GatewayError:
                    return
                assert status.code == 0
                told[key] = (value, commit.tx_id, status.block_number)

        clients = [asyncio.ensure_future(client(number)) for number in range(8)]
        await asyncio.sleep(after_s)
        outage.strike(process.pid)
        await asyncio.to_thread(process.communicate, timeout=10)
        await asyncio.gather(*clients)
        outage.back()


@pytest.mark.parametrize("seed", range(4))
async def test_every_commit_that_was_told_survives(outage, seed):
    chance = random.Random(seed)
    told = {}
    directory = outage.directory / "ledger"
    for round_ in range(3):
        process, _ = await asyncio.to_thread(start, directory)
        try:
            await write_until_struck(outage, directory, process, told, 0.15 + 0.3 * chance.random(), round_)
        finally:
            if process.poll() is None:
                kill(process)
        reader = StateReader(directory / "ledger.sqlite3")
        verify_tip(reader, depth=10_000)
        tip = reader.tip()
        for key, (value, tx_id, block) in told.items():
            assert reader.get("pol", key)[0] == value.encode()
            location = reader.transaction(tx_id)
            assert (location.block, location.code) == (block, 0)
        # State, history and index hold exactly what the blocks say: no half block.
        expected = {}
        for number in range(tip.number + 1):
            for index, transaction in enumerate(parse_block(reader.block(number)).transactions):
                assert reader.transaction(transaction.tx_id).position == index
                for _, write in transaction.writes if transaction.is_valid else ():
                    expected[write.key] = (write.value, (number, index))
        assert {key: (value, version) for key, value, version in reader.range("pol", "", "")} == expected
        reader.close()
    assert told


async def test_a_kill_during_the_first_start_is_survived(tmp_path):
    for delay_s in (0.25, 0.3, 0.35, 0.4, 0.45):
        process = subprocess.Popen(
            [sys.executable, *SERVER, tmp_path / "l"],
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        await asyncio.sleep(delay_s)
        await asyncio.to_thread(kill, process)
    process, _ = await asyncio.to_thread(start, tmp_path / "l")
    try:
        connection = Connection.load(tmp_path / "l")
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("uav"), connection.signer("uav"))
            assert (await gateway.network("wonderland").contract("pol").submit("put", "k", "v")).block_number == 1
    finally:
        kill(process)


async def test_a_client_survives_the_kill_and_restart_on_the_same_port(tmp_path):
    process, address = await asyncio.to_thread(start, tmp_path / "l")
    try:
        connection = Connection.load(tmp_path / "l")
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
            network = gateway.network("wonderland")
            done = await network.contract("pol").submit("put", "k", "1")
            events = network.chaincode_events("pol", start_block=0, reconnect=True)
            async with events:
                await asyncio.to_thread(kill, process)
                process, _ = await asyncio.to_thread(start, tmp_path / "l", address)
                assert (await network.commit(done.tx_id).status()).block_number == done.block_number
                again = await network.contract("pol").submit("put", "k", "2", "Back")
                event = await asyncio.wait_for(anext(events), 10)
                assert event.tx_id == again.tx_id
    finally:
        kill(process)
