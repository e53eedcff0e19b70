"""A backend in a process of its own for the benchmarks of the live push: `python -m bench.live_server hub|raw RATE DIRECTORY`.

Both hear RATE positions a second and make one frame of them at each tick. `hub` sends it as the product does; `raw`
sends the very same bytes over the same server with nothing around: one send after the other, no queue, no resuming.
Prints its port and a link. `rate N` on its standard input changes the rate, `link` asks for another link, any other
line what it did so far.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from pathlib import Path

import orjson
from bench.map_page import crowd_frame
from fastapi import WebSocket
from kit.chain import Authorities
from kit.console import RealBackend
from starlette.websockets import WebSocketDisconnect

from wonderland_backend.serve import leave_to_itself

FEED_S = 0.04


class Feed:
    """Positions of so many drones, evenly over time."""

    def __init__(self, board, rate, drones, field):
        self._board = board
        self.rate = rate
        # Made once: the making must not take the time that is measured.
        self._bodies = [pair for sequence in range(4) for pair in crowd_frame(drones, sequence, 0, *field)]
        self.heard = 0

    async def run(self):
        """Until cancelled."""
        at, owed, before = 0, 0.0, time.monotonic()
        while True:
            await asyncio.sleep(FEED_S)
            now, t_ms = time.monotonic(), time.time_ns() // 1_000_000
            stamp = f'"t_ms":{t_ms},'
            owed += (now - before) * self.rate
            before = now
            due = int(owed)
            owed -= due
            for _ in range(due):
                uav_id, body = self._bodies[at]
                self._board.hear(uav_id, t_ms, body.replace('"t_ms":0,', stamp))
                at = (at + 1) % len(self._bodies)
            self.heard += due


class Raw:
    """The same frames, sent to all sockets one after the other."""

    def __init__(self, board, tick_s):
        self.board = board
        self.tick_s = tick_s
        self.sockets = set()
        self.sent = 0
        self.bytes = 0

    async def endpoint(self, socket: WebSocket):
        """A client."""
        await socket.accept()
        self.sockets.add(socket)
        try:
            while True:
                await socket.receive_text()
        except WebSocketDisconnect:
            self.sockets.discard(socket)

    async def run(self):
        """Tick."""
        seq = 0
        while True:
            await asyncio.sleep(self.tick_s)
            changed = self.board.take_changes(with_status=False)
            if not changed:
                continue
            seq += 1
            frame = orjson.dumps({"type": "delta", "seq": seq, "t_ms": time.time_ns() // 1_000_000, **changed}).decode()
            for socket in list(self.sockets):
                await socket.send_text(frame)
            self.sent += len(self.sockets)
            self.bytes += len(self.sockets) * len(frame)


def field_of(options):
    """(centre, spread) of the drones, where one is given."""
    if options.field is None:
        return ()
    lat, lon, spread = map(float, options.field.split(","))
    return (round(lat * 1e7), round(lon * 1e7)), spread


async def prepare(backend, options):
    """Start what makes positions, and for `raw` what sends them; returns tasks, the feed, and where the counts are."""
    parts = backend.backend.parts
    feed = Feed(parts.board, options.rate, options.drones or options.rate, field_of(options))
    tasks = [asyncio.create_task(feed.run())]
    if options.mode == "hub":
        return tasks, feed, lambda: (parts.hub.frames, parts.hub.bytes)
    raw = Raw(parts.board, options.tick_ms / 1000)
    # The hub has no clients here; it must not take away what changed.
    parts.hub.tick = lambda: None
    backend.backend.app.add_api_websocket_route("/raw", raw.endpoint)
    backend.backend.app.router.routes.insert(0, backend.backend.app.router.routes.pop())
    tasks.append(asyncio.create_task(raw.run()))
    return tasks, feed, lambda: (raw.sent, raw.bytes)


async def cancel(tasks):
    """End what prepare() has started."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def credentials(authorities, pad_id):
    """With which an agent of this pad signs."""
    made = authorities.enrol(pad_id, role="pad", id=pad_id)
    return {"id": pad_id, "certificate": made.certificate_pem.decode(), "key": made.private_key_pem.decode()}


def parsed():
    parser = argparse.ArgumentParser()
    parser.add_argument("mode", choices=("hub", "raw"))
    parser.add_argument("rate", type=int)
    parser.add_argument("directory", type=Path)
    parser.add_argument("--drones", type=int, default=0, help="how many drones report; without it, each once a second")
    parser.add_argument("--tick-ms", type=int, default=100)
    parser.add_argument("--console", type=Path, help="the built console, which it serves")
    parser.add_argument("--map", type=Path, help="an archive that the console's map is drawn from")
    parser.add_argument("--field", help="LAT,LON,SPREAD: where the drones are, and how far apart beside the usual")
    parser.add_argument("--pads", type=int, default=1, help="with their credentials in DIRECTORY/pads.json")
    return parser.parse_args()


def main():
    options = parsed()
    authorities = Authorities(options.directory / "ca")
    settings = {"tick_ms": options.tick_ms} | ({"map": {"archive": options.map}} if options.map else {})
    running = RealBackend(authorities, options.directory, options.console, **settings)
    pads = [f"pad-{number}" for number in range(1, options.pads + 1)]
    running.add(*(running.facts.put_pad(pad_id) for pad_id in pads))
    (options.directory / "pads.json").write_text(json.dumps([credentials(authorities, pad_id) for pad_id in pads]))
    running.start()
    tasks, feed, counts = running._run(prepare(running, options))
    leave_to_itself()
    print(json.dumps({"port": running.port, "link": running.link()}), flush=True)
    for line in sys.stdin:
        word, *rest = line.split() or [""]
        if word == "rate":
            feed.rate = int(rest[0])
        if word == "link":
            print(json.dumps({"link": running.link()}), flush=True)
            continue
        frames, size = counts()
        heard = running.backend.parts.intake.records or feed.heard
        print(json.dumps({"frames": frames, "bytes": size, "heard": heard}), flush=True)
    running._run(cancel(tasks))
    running.close()


if __name__ == "__main__":
    main()
