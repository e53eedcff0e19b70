"""A ledger in a process of its own, with the tests' contract: python -m kit.ledger_process DIRECTORY [LISTEN]."""

import asyncio
import signal
import sys
from pathlib import Path

from kit.embedded import ToyContract
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import BatchLimits


async def main(directory, listen):
    settings = LedgerSettings(listen=listen, limits=BatchLimits(time_ms=2))
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    async with EmbeddedLedger(Path(directory), {"pol": ToyContract()}, settings) as ledger:
        print(ledger.connection.gateway.address, flush=True)
        await stop.wait()


asyncio.run(main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "127.0.0.1:0"))
