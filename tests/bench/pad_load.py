"""Pads in a process of their own, for the benchmarks of a position's way to the screen.

`pad_load.py stream URL CREDENTIALS RATE`: RATE positions a second in all from as many pads as there are credentials,
sent as an agent's uplink does, with what its spool gathers at a time. `pad_load.py receiver URL CREDENTIALS`: the first
pad's own receiver, spool and uplink; prints the UDP port that it listens at. Each tenth drone of a stream is a beacon
(map_page.py). Ends with its standard input.
"""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
import time
from pathlib import Path

import orjson
import websockets
from bench.map_page import beacon
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from wonderland.telemetry import Credentials
from wonderland_edge_agent.assembly import _tell
from wonderland_edge_agent.receiver import RemoteIdReceiver
from wonderland_edge_agent.receiver.sources.udp import UdpSource
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.spool.store import StoredRecord
from wonderland_edge_agent.uplink import Uplink, UplinkProtocol, WebSocketTransport
from wonderland_fabric_gateway.signing import key_signer

LINGER_S = 0.05
BEACONS = 50


def credentials_of(path):
    """Of each pad, as the server wrote them."""
    return [
        Credentials(
            agent="pad",
            id=each["id"],
            msp_id="PadMSP",
            certificate_pem=each["certificate"],
            sign=key_signer(load_pem_private_key(each["key"].encode(), None)),
        )
        for each in json.loads(Path(path).read_text())
    ]


def body(number, t_ms):
    """A position as a receiver tells it."""
    lat_e7, lon_e7 = (
        beacon(number, t_ms) if number < BEACONS else (604_500_000 + number * 500, 222_500_000 + t_ms % 900)
    )
    return orjson.dumps(
        {
            "accuracy_mm": 3_000,
            "claim_t_ms": t_ms,
            "height_mm": 60_000,
            "lat_e7": lat_e7,
            "latency_ms": 40,
            "lon_e7": lon_e7,
            "rssi": -61,
            "speed_mm_s": 12_000,
            "track_cdeg": 9_000,
            "transport": "wifi_beacon",
            "uav_id": f"SE-{number:04d}",
            "vertical_mm_s": 0,
        }
    )


async def stream(url, credentials, rate, index, pads):
    """One pad: its drones report once a second, evenly spread."""
    # On a machine with too much to do, slow answers are what is measured, and no reason to hang up.
    async with websockets.connect(url, compression=None, max_queue=64, ping_interval=None) as socket:
        protocol = UplinkProtocol(credentials, f"{index:032x}")
        await socket.send(protocol.receive(await socket.recv()).text)
        protocol.receive(await socket.recv())

        async def acknowledgements():
            async for text in socket:
                protocol.receive(text)

        reading = asyncio.create_task(acknowledgements())
        drones = [number for number in range(rate) if number % pads == index]
        seq, began = 0, time.monotonic()
        try:
            while not reading.done():
                await asyncio.sleep(LINGER_S)
                due = int((time.monotonic() - began) * len(drones))
                t_ms = time.time_ns() // 1_000_000
                records = []
                while seq < due:
                    seq += 1
                    records.append(StoredRecord(seq, "track", t_ms, body(drones[seq % len(drones)], t_ms)))
                if records:
                    await socket.send(protocol.records(records))
        finally:
            reading.cancel()


async def receiver(url, credentials):
    """The pad's receiver, spool and uplink, joined as the agent joins them."""
    source = UdpSource("127.0.0.1", 0)
    with tempfile.TemporaryDirectory() as directory:
        async with await Spool.open(Path(directory) / "spool", owner=credentials.id) as spool:
            tracks = SpoolReporter(spool)
            hearing = RemoteIdReceiver(
                sources=[source],
                on_heard=lambda heard: _tell(tracks, heard),
                on_finding=lambda _: None,
            )
            await hearing.start()
            uplink = Uplink(WebSocketTransport(url), credentials, spool)
            await uplink.start()
            try:
                while not uplink.status.connected:
                    await asyncio.sleep(0.05)
                print(json.dumps({"port": source.address[1]}), flush=True)
                await asyncio.Event().wait()
            finally:
                await uplink.close()
                await hearing.close()


async def main():
    mode, url, path, *more = sys.argv[1:]
    pads = credentials_of(path)
    if mode == "receiver":
        tasks = [asyncio.create_task(receiver(url, pads[0]))]
    else:
        rate = int(more[0])
        tasks = [asyncio.create_task(stream(url, each, rate, index, len(pads))) for index, each in enumerate(pads)]
        print("{}", flush=True)
    ended = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
    done, _ = await asyncio.wait([ended, *tasks], return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for task in done - {ended}:
        task.result()


if __name__ == "__main__":
    asyncio.run(main())
