"""Submits assets until a peer has ended: ``fill_peer.py NETWORK COMPONENT``."""

import asyncio
import base64
import json
import os
import sys
import time
from pathlib import Path

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway, GatewayError
from wonderland_fabric_network import bringing_up
from wonderland_fabric_network.layout import NetworkDirectory


async def main(directory, component):
    network = bringing_up.open_network(NetworkDirectory(directory))
    connection = Connection.load(directory)
    deadline = time.monotonic() + 60
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("admin"), connection.signer("admin"))
        contract = gateway.network(connection.channel).contract(connection.chaincode)
        while network.processes.pid(component) is not None:
            assert time.monotonic() < deadline, "the peer goes on"
            asset = {
                "id": f"asset-{os.urandom(4).hex()}",
                "type": "ballast",
                "media_type": "application/octet-stream",
                "value": base64.urlsafe_b64encode(os.urandom(90_000)).decode().rstrip("="),
            }
            try:
                async with asyncio.timeout(10):
                    await contract.submit("CreateAsset", json.dumps(asset))
            except (GatewayError, TimeoutError) as error:
                print(error)
                await asyncio.sleep(0.1)


asyncio.run(main(Path(sys.argv[1]), sys.argv[2]))
