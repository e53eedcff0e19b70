"""The world's process: ``python -m simulator.run_world PLAN``."""

from __future__ import annotations

import sys
from pathlib import Path

from simulator.plan import Plan, run_until_told
from simulator.world import World

if __name__ == "__main__":
    plan = Plan.read(Path(sys.argv[1]))
    run_until_told(World(plan.pads, plan.drones, plan.directory, plan.ports, seed=plan.seed).run)
