"""``wonderland pad``: calibrate a pad, run its agent, and see how it is."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    lazy={
        "calibrate-uav": (
            "wonderland_edge_agent.commissioning.calibrate_command:calibrate_uav",
            "Measure what a drone's node adds to every range, and register it.",
        ),
        "commission": (
            "wonderland_edge_agent.commissioning.commands:commission",
            "Find how far off each anchor's ranges are, and what the pad can verify.",
        ),
        "run": ("wonderland_edge_agent.agent_commands:run", "Work until told to stop (Ctrl-C or SIGTERM)."),
        "site-plan": ("wonderland_edge_agent.site_plan_command:site_plan", "Check a plan of the pad's site (GeoJSON)."),
        "swap-node": (
            "wonderland_edge_agent.commissioning.swap_command:swap_node",
            "Take a new node into the commissioning in place of a broken one.",
        ),
        "status": ("wonderland_edge_agent.status_command:status", "Say how the pad is."),
    },
)
def pad() -> None:
    """Calibrate a landing pad, and run its agent.

    \b
    A pad is known to the ledger (RegisterPad), surveyed (CommissionPad) and has an identity with the role "pad".
      wonderland pad commission --recording ranges.csv --anchors anchors.csv --out commissioning.json
      wonderland pad site-plan plan.geojson
      wonderland pad run --config pad.toml
      wonderland pad status --config pad.toml
      wonderland pad swap-node --config pad.toml --anchor A3
      wonderland pad calibrate-uav --config pad.toml --uav 1596F0123 --at 0.30,-0.20,0.15

    pad.toml names the pad, connection.json with the identity, a directory for the spool, one serial port for each
    anchor, where Remote ID is heard, and the backend. A mistake in it is reported with the field's name.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
