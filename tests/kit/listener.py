"""A listener that may be killed at any moment: python listener.py CONNECTION.json IDENTITY DATABASE

Each event of the contract becomes a row, in one database transaction with the place to continue at: exactly once.
"""

import asyncio
import sqlite3
import sys
from pathlib import Path

from wonderland_fabric_gateway.checkpoints import SqliteCheckpointer
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway


def open_database(path):
    """The rows and the checkpoint."""
    database = sqlite3.connect(path, timeout=30)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("CREATE TABLE IF NOT EXISTS events (block INTEGER, tx_id TEXT, name TEXT)")
    SqliteCheckpointer(database, "events").create_table()
    database.commit()
    return database


async def main(connection_file, identity, path):
    connection = Connection.load(Path(connection_file))
    database = open_database(path)
    checkpointer = SqliteCheckpointer(database, "events")
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity(identity), connection.signer(identity))
        network = gateway.network(connection.channel)
        stream = network.chaincode_events(
            connection.chaincode, start_block=0, checkpointer=checkpointer, reconnect=True
        )
        async with stream:
            print("listening", flush=True)
            async for event in stream:
                row = (event.block_number, event.tx_id, event.name)
                database.execute("INSERT INTO events VALUES (?, ?, ?)", row)
                checkpointer.save(event.checkpoint)
                database.commit()


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
