"""What a drone's agent makes of PX4's topics, in a process of its own: claims and reasons as JSON lines.

Zenoh's threads are one set for a whole process, and stay in the network in which they began: a test that takes itself
into a network of its own needs a process for them.
"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

from wonderland.clock import SteadyClock
from wonderland_uav_agent.sources import open_position


async def main(geoid):
    clock = SteadyClock()
    async with open_position("ros2:px4", clock, geoid, wait=False) as source:
        while True:
            now_ms = clock()
            claim = source.claim(now_ms)
            said = {"t_ms": now_ms, "why": source.why_not(now_ms), "claim": claim and claim.to_json()}
            sys.stdout.write(json.dumps(said) + "\n")
            sys.stdout.flush()
            await asyncio.sleep(0.1)


asyncio.run(main(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
