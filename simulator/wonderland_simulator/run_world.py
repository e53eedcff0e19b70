"""The world's process: ``python -m wonderland_simulator.run_world PLAN``."""

from __future__ import annotations

import sys
from pathlib import Path

from wonderland_simulator.plan import Plan, run_until_told
from wonderland_simulator.world import World

if __name__ == "__main__":
    plan = Plan.read(Path(sys.argv[1]))
    run_until_told(World(plan.pads, plan.drones, plan.directory, plan.ports, seed=plan.seed).run)
