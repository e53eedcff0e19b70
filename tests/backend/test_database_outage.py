"""What the backend acknowledged to an agent, which then forgets it, outlives the backend's machine going out."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import PIPE

import sqlalchemy

from wonderland_backend.db.engine import Database

WRITER = """
import asyncio, os, sys
import sqlalchemy
from wonderland_backend.db.engine import Database

async def main():
    database = Database(sys.argv[1])
    number = int(sys.argv[2])
    async with database.write() as connection:
        await connection.execute(sqlalchemy.text("CREATE TABLE IF NOT EXISTS told (n INTEGER PRIMARY KEY)"))
    while True:
        async with database.write() as connection:
            await connection.execute(sqlalchemy.text("INSERT INTO told VALUES (:n)"), {"n": number})
        os.write(1, f"{number}\\n".encode())
        number += 1

asyncio.run(main())
"""


async def test_every_write_that_was_told_survives(outage):
    url = f"sqlite:///{outage.directory / 'backend.sqlite3'}"
    told = 0
    for _ in range(3):
        process = await asyncio.create_subprocess_exec(sys.executable, "-c", WRITER, url, str(told + 2), stdout=PIPE)
        output = b""
        for _ in range(20):
            output += await process.stdout.readuntil(b"\n")
        outage.strike(process.pid)
        output += await process.stdout.read()
        await process.wait()
        outage.back()
        numbers = [int(line) for line in output.split()]
        database = Database(url)
        async with database.read() as session:
            kept = set(await session.scalars(sqlalchemy.text("SELECT n FROM told")))
        await database.close()
        assert set(numbers) <= kept
        told = max(kept)
