"""``wonderland ros2``: a pad as a node of ROS 2."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup


@click.group(
    cls=LazyGroup,
    lazy={
        "interfaces": ("wonderland_ros_bridge.ros2.interfaces_command:interfaces", "Write the interface package."),
        "run": ("wonderland_ros_bridge.ros2.run_command:run", "Work until told to stop."),
    },
)
def ros2() -> None:
    """ROS 2 (rmw_zenoh), without a ROS installation.

    \b
      wonderland ros2 run --config ros2.toml
      wonderland ros2 interfaces ./src
    """  # noqa: D301 - \b is click's mark for "do not wrap"
