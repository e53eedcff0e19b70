"""A listener in a process of its own, killed; the ledger killed, too: each event once, in order."""

import asyncio
import signal
import subprocess
import sys

import pytest
from kit import environment
from kit.listening import Listener

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway

SERVER = ["-m", "kit.ledger_process"]
pytestmark = pytest.mark.timeout(180)


def start(directory, listen="127.0.0.1:0"):
    process = subprocess.Popen(
        [sys.executable, *SERVER, directory, listen], env=environment(), stdout=subprocess.PIPE, text=True
    )
    return process, process.stdout.readline().strip()


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.wait(10)
    process.stdout.close()


async def test_nothing_is_lost_or_repeated_over_kill_9(tmp_path):
    directory = tmp_path / "ledger"
    server, address = await asyncio.to_thread(start, directory)
    listener = Listener(directory / "connection.json", "uav", tmp_path / "events.db")
    told = []
    try:
        connection = Connection.load(directory)
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
            contract = gateway.network("wonderland").contract("pol")

            async def put(count):
                for _ in range(count):
                    done = await contract.submit("put", f"k{len(told)}", "v", "Put")
                    told.append((done.block_number, done.tx_id, "Put"))

            await listener.start()
            await put(10)
            await listener.kill()  # in the midst of it, perhaps
            await put(10)  # while nobody listens
            await listener.start()
            await put(5)
            await asyncio.to_thread(kill, server)
            server, _ = await asyncio.to_thread(start, directory, address)
            await put(5)
            await listener.kill()
            await listener.start()
            await listener.reach(told[-1][1])
    finally:
        await listener.kill()
        await asyncio.to_thread(kill, server)
    assert listener.rows() == told
