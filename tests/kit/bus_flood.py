"""``python -m kit.bus_flood MEMBER.json SECONDS``: one with a certificate puts as fast as it can, at its own keys."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from wonderland_bus import keys
from wonderland_bus.segments import Kind, Segment
from wonderland_bus.session import open_member
from wonderland_bus.settings import Member, Tls

if __name__ == "__main__":
    told, seconds = json.loads(sys.argv[1]), float(sys.argv[2])
    tls = Tls(**{name: Path(path) for name, path in told["tls"].items()})
    place = keys.opening if told["at"] == "open" else keys.up
    with open_member(Member(routers=told["routers"], tls=tls)) as session:
        me, number, until_s = tls.peer(), 0, time.monotonic() + seconds
        print("ready", flush=True)
        while time.monotonic() < until_s:
            number += 1
            session.put(place(me, f"{number % 5_000:032x}"), Segment(Kind.DATA, 0, 0, 0, b"x" * 100).encode())
        print(number, flush=True)
