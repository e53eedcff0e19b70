"""``wonderland ros1``: topics of ROS 1 to the ledger and back."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    lazy={
        "delete": ("wonderland_ros_bridge.asset_commands:delete", "Delete an asset of this bridge."),
        "history": ("wonderland_ros_bridge.asset_commands:history", "Show an asset's changes."),
        "read": ("wonderland_ros_bridge.asset_commands:read", "Show an asset, its messages decoded."),
        "rejected": ("wonderland_ros_bridge.spool_commands:rejected", "Show what the ledger refused, and why."),
        "run": ("wonderland_ros_bridge.run_command:run", "Work until told to stop."),
        "status": ("wonderland_ros_bridge.spool_commands:status", "Say what waits for the ledger."),
    },
)
def ros1() -> None:
    """ROS 1 and the ledger: any topic and any message type, without a ROS installation.

    \b
      wonderland ros1 run --config ros1.toml
      wonderland ros1 status --config ros1.toml
      wonderland ros1 history --config ros1.toml /fix
    """  # noqa: D301 - \b is click's mark for "do not wrap"
