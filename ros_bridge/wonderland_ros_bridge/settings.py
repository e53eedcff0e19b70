"""``ros1.toml``: the ledger, the master, and what goes which way."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from wonderland.toml_settings import FieldError, Table, Text, load_toml
from wonderland_ros_bridge.ledger.listener import Choice
from wonderland_ros_bridge.ledger.policy import Rule, Topic
from wonderland_ros_bridge.ros1.hosts import LOOPBACK

BridgeName = Annotated[str, Meta(max_length=40, pattern=r"\A[A-Za-z0-9][A-Za-z0-9_.-]*\Z")]
SpoolBytes = Annotated[int, Meta(ge=1 << 20, le=1 << 40)]
PREFIX = "ros1"
"""With which the ids of this bridge's assets begin."""


class LedgerSettings(Table, frozen=True):
    """``[ledger]``: where it is, and as whom the bridge speaks."""

    connection: Path
    """``connection.json``."""
    identity: Text
    """A name in ``connection.json``."""


class Ros1Settings(Table, frozen=True):
    """``[ros1]``: the master, and where this node listens."""

    master: Annotated[str, Meta(pattern=r"\Ahttp://[^/\s]+/?\Z")] = "http://127.0.0.1:11311"
    """The address of ROS’s master."""
    node: Annotated[str, Meta(max_length=100, pattern=r"\A/[A-Za-z][A-Za-z0-9_/]*\Z")] = "/wonderland"
    """This node’s name."""
    host: Text = "127.0.0.1"
    """Where it listens, and under which name others find it."""
    port: Annotated[int, Meta(ge=0, lt=65_536)] = 0
    """The port there; 0: any free one."""
    networks: tuple[Text, ...] = LOOPBACK
    """With whose nodes it speaks."""

    def __post_init__(self) -> None:
        """Networks are networks."""
        for each in self.networks:
            try:
                ipaddress.ip_network(each)
            except ValueError as cause:
                raise FieldError(f"networks: {each!r} is no network, for example 192.168.7.0/24 ({cause})") from cause


class Settings(Table, frozen=True):
    """The whole file."""

    bridge: BridgeName
    """This bridge's name on the ledger."""
    spool: Path
    """The file in which messages wait for the ledger."""
    ledger: LedgerSettings
    ros1: Ros1Settings = Ros1Settings()
    max_spool_bytes: SpoolBytes = 1 << 30
    """Beyond it nothing more is read from publishers until the ledger has taken some."""
    orders: Topic | None = None
    """A topic (``std_msgs/String``) on which the robot's own programs give orders about this bridge's assets."""
    to_ledger: tuple[Rule, ...] = ()
    from_ledger: tuple[Choice, ...] = ()
    from_start: bool = False
    """At the very first start: all that the ledger ever committed, not only what comes from now on."""

    def __post_init__(self) -> None:
        """It has something to do."""
        if not self.to_ledger and not self.from_ledger and self.orders is None:
            raise FieldError(
                "to_ledger: there is no [[to_ledger]], no [[from_ledger]], no orders; the bridge has nothing to do"
            )


def load(path: Path) -> Settings:
    """The settings of a file. Raises SettingsError."""
    return load_toml(path, Settings)
