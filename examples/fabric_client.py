"""A Fabric Gateway client in ten lines: python fabric_client.py connection.json IDENTITY."""

import asyncio
import sys
from pathlib import Path

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway


async def main(path: str, name: str) -> None:
    connection = Connection.load(Path(path))
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity(name), connection.signer(name))
        network = gateway.network(connection.channel)
        print(await network.contract(connection.chaincode).evaluate("ReadPolicy", '{"action":"land","pad_id":"pad-1"}'))
        async with network.chaincode_events(connection.chaincode, start_block=0) as events:
            async for event in events:  # for ever; Ctrl-C ends it
                print(event.block_number, event.name, event.tx_id, flush=True)


asyncio.run(main(*sys.argv[1:]))
