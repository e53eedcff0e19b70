"""``wonderland uav``: the drone's side of a proof, from its companion computer."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    lazy={
        "calibrate": (
            "wonderland_uav_agent.agent_commands:calibrate",
            "Be ranged by a pad whose operator calibrates this drone's node.",
        ),
        "prove": ("wonderland_uav_agent.agent_commands:prove", "Prove where the drone is."),
        "reserve": (
            "wonderland_uav_agent.reserve_command:reserve",
            "Have a pad kept for this drone's landing, or see for whom it is kept.",
        ),
        "serve": (
            "wonderland_uav_agent.agent_commands:serve",
            "Stay, and prove where the drone is when the authority or its operator asks.",
        ),
    },
)
def uav() -> None:
    """The drone's side: ask a pad for a proof of location, take part in it, and act when it is granted.

    \b
      wonderland uav prove --connection ledger/connection.json --identity uav --port /dev/ttyUSB0 \\
          --position udp:127.0.0.1:5500 --pad pad-1 --action land
      wonderland uav calibrate … --pad pad-1      (beside wonderland pad calibrate-uav, on the pad's mark)
    """  # noqa: D301 - \b is click's mark for "do not wrap"
