"""``wonderland ros2``: a pad as a node of ROS 2, and topics to the ledger and back."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    context_settings={"obj": "ros2"},
    lazy={
        "delete": ("wonderland_ros_bridge.asset_commands:delete", "Delete an asset of this bridge."),
        "history": ("wonderland_ros_bridge.asset_commands:history", "Show an asset's changes."),
        "read": ("wonderland_ros_bridge.asset_commands:read", "Show an asset, its messages decoded."),
        "rejected": ("wonderland_ros_bridge.spool_commands:rejected", "Show what the ledger refused, and why."),
        "status": ("wonderland_ros_bridge.spool_commands:status", "Say what waits for the ledger."),
        "interfaces": ("wonderland_ros_bridge.ros2.interfaces_command:interfaces", "Write the interface package."),
        "router": ("wonderland_ros_bridge.ros2.router_command:router", "Be what peers meet at, without ROS."),
        "run": ("wonderland_ros_bridge.ros2.run_command:run", "Work until told to stop."),
    },
)
def ros2() -> None:
    """ROS 2 (rmw_zenoh), without a ROS installation.

    \b
      wonderland ros2 run --config ros2.toml
      wonderland ros2 interfaces ./src
    """  # noqa: D301 - \b is click's mark for "do not wrap"
