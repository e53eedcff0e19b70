"""The process of the drones' agents: ``python -m wonderland_simulator.run_fleet PLAN``."""

from __future__ import annotations

import sys
from pathlib import Path

from wonderland_fabric_gateway.connection import Connection
from wonderland_simulator.fleet import Fleet
from wonderland_simulator.plan import Plan, run_until_told
from wonderland_uav_agent.position.autopilot import AutopilotPosition

if __name__ == "__main__":
    plan = Plan.read(Path(sys.argv[1]))
    fleet = Fleet(
        Connection.load(plan.connection),
        plan.drones,
        plan.directory,
        plan.ports,
        open_position=lambda port, clock: AutopilotPosition(("127.0.0.1", port), clock),
    )
    run_until_told(fleet.run)
