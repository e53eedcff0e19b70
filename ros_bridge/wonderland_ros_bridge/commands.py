"""``wonderland ros1``: topics of ROS 1 to the ledger and back."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    lazy={
        "run": ("wonderland_ros_bridge.run_command:run", "Work until told to stop."),
    },
)
def ros1() -> None:
    """ROS 1 and the ledger: any topic and any message type, without a ROS installation.

    \b
      wonderland ros1 run --config ros1.toml
    """  # noqa: D301 - \b is click's mark for "do not wrap"
