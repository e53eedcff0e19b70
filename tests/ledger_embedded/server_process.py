"""A ledger in a process of its own, with the tests' contract: python server_process.py DIRECTORY [LISTEN]."""

import asyncio
import importlib.util
import signal
import sys
from pathlib import Path

from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits

spec = importlib.util.spec_from_file_location("embedded_conftest", Path(__file__).with_name("conftest.py"))
conftest = importlib.util.module_from_spec(spec)
sys.modules["embedded_conftest"] = conftest
spec.loader.exec_module(conftest)


async def main(directory, listen):
    settings = LedgerSettings(listen=listen, limits=BatchLimits(time_ms=2))
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    async with EmbeddedLedger(Path(directory), {"pol": conftest.ToyContract()}, settings) as ledger:
        print(ledger.connection.gateway.address, flush=True)
        await stop.wait()


asyncio.run(main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "127.0.0.1:0"))
