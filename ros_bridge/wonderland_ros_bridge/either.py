"""The settings of a bridge to ROS 1 or to ROS 2, as the commands beside ``run`` need them: by the group's name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from wonderland.toml_settings import SettingsError
from wonderland_rmw_zenoh.errors import Ros2Error
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_ros_bridge import settings as ros1
from wonderland_ros_bridge.errors import DefinitionError
from wonderland_ros_bridge.ledger.envelope import Batch
from wonderland_ros_bridge.ros1 import definitions
from wonderland_ros_bridge.ros1.publisher import definition_of
from wonderland_ros_bridge.ros2 import settings as ros2
from wonderland_ros_bridge.ros2.topics import type_of


@dataclass(frozen=True, slots=True)
class Settings:
    """What both have."""

    prefix: str
    bridge: str
    spool: Path
    ledger: ros1.LedgerSettings
    interfaces: tuple[Path, ...] = ()

    @property
    def command(self) -> str:
        """As one calls it."""
        return f"wonderland {self.prefix}"


def load(path: Path) -> Settings:
    """The settings of a file. Raises SettingsError."""
    context = click.get_current_context(silent=True)
    if context is None or context.obj != ros2.PREFIX:
        of_ros1 = ros1.load(path)
        return Settings(ros1.PREFIX, of_ros1.bridge, of_ros1.spool, of_ros1.ledger)
    of_ros2 = ros2.load(path)
    if of_ros2.bridge is None or of_ros2.spool is None:
        raise SettingsError(f"{path}: it has no topics to the ledger and back, and so no spool and no assets")
    return Settings(ros2.PREFIX, of_ros2.bridge, of_ros2.spool, of_ros2.ledger, of_ros2.interfaces)


def message_reader(batch: Batch, definition: str | None, interfaces: tuple[Path, ...] = ()) -> Callable[[bytes], Any]:
    """What shows a batch's messages to people. Raises DefinitionError."""
    if batch.encoding == "ros1":
        return definitions.codec(batch.type, definition_of(batch, definition).text).to_json
    try:
        return type_of(Interfaces(interfaces), batch, definition).codec.to_json
    except Ros2Error as error:
        raise DefinitionError(str(error)) from error
