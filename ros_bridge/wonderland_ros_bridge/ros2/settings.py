"""``ros2.toml``: the ledger, the way to other peers, and the pad."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from msgspec import Meta

from wonderland.toml_settings import FieldError, Identifier, Table, Text, load_toml
from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.session import ROUTER, Link, Tls
from wonderland_ros_bridge.ledger.listener import Choice
from wonderland_ros_bridge.ledger.policy import Rule
from wonderland_ros_bridge.settings import BridgeName, LedgerSettings, SpoolBytes

PREFIX = "ros2"
"""With which the ids of this bridge's assets begin."""
RmfName = Annotated[str, Meta(min_length=1, max_length=200, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]
FrameName = Annotated[str, Meta(max_length=60, pattern=r"\A[A-Za-z_][A-Za-z0-9_]*\Z")]


class TlsSettings(Table, frozen=True):
    """``[ros2.tls]``: certificates (PEM), without which no other machine is spoken with."""

    ca: Path
    """Of whom certificates are believed."""
    certificate: Path
    """This node’s."""
    key: Path
    """Its private key."""
    peers: tuple[Text, ...] = ()
    """Common names of the peers that are heard; empty: all whom the authority vouches for."""


class Ros2Settings(Table, frozen=True):
    """``[ros2]``: how this machine's node meets the others."""

    domain: Annotated[int, Meta(ge=0, le=wire.MAX_DOMAIN)] = 0
    """``ROS_DOMAIN_ID``."""
    connect: tuple[Text, ...] = (ROUTER,)
    """Routers (``rmw_zenohd``) or peers."""
    listen: tuple[Text, ...] = ()
    """Where peers find this node; left out: a free port of this machine."""
    tls: TlsSettings | None = None

    def __post_init__(self) -> None:
        """Addresses are addresses, and other machines' are encrypted."""
        if problem := self.link().problem():
            raise FieldError(problem)

    def link(self) -> Link:
        """For a session."""
        listen = self.listen or ("tcp/127.0.0.1:0" if self.tls is None else "tls/127.0.0.1:0",)
        tls = None if self.tls is None else Tls(self.tls.ca, self.tls.certificate, self.tls.key, self.tls.peers)
        return Link(self.connect, listen, tls)


class OpenRmfSettings(Table, frozen=True):
    """``[pad.open_rmf]``: the pad as a door of Open-RMF. RMF may ask for it; only a proof opens it."""

    door: RmfName | None = None
    """The door’s name in RMF’s building map; left out: ``pad_id``."""
    mutex_group: RmfName | None = None
    """The mutex group of the pad’s waypoint, locked while somebody has a permission; left out: none is."""


class PadNodeSettings(Table, frozen=True):
    """``[pad]``: which pad is a node."""

    pad_id: Identifier
    """The pad’s name on the ledger."""
    reports: Path
    """The socket on which its agent tells (``local_reports`` of ``pad.toml``)."""
    map_frame: FrameName = "map"
    """The frame in which the pad’s own frame stands."""
    open_rmf: OpenRmfSettings | None = None

    @property
    def node(self) -> str:
        """The node's full name."""
        return f"/wonderland/{wire.as_name(self.pad_id)}"

    @property
    def frame(self) -> str:
        """The pad's frame: east, north and up from the origin of its survey."""
        return wire.as_name(self.pad_id)


class Settings(Table, frozen=True):
    """The whole file: a pad, or topics to the ledger and back, or both."""

    ledger: LedgerSettings
    ros2: Ros2Settings = Ros2Settings()
    pad: PadNodeSettings | None = None
    bridge: BridgeName | None = None
    """The bridge's name on the ledger."""
    spool: Path | None = None
    """The file in which messages wait for the ledger."""
    interfaces: tuple[Path, ...] = ()
    """Directories with definitions of messages: an installation's ``share``, a workspace's ``install``, packages."""
    max_spool_bytes: SpoolBytes = 1 << 30
    """Beyond it nothing more is read from publishers until the ledger has taken some."""
    to_ledger: tuple[Rule, ...] = ()
    from_ledger: tuple[Choice, ...] = ()
    from_start: bool = False
    """At the very first start: all that the ledger ever committed, not only what comes from now on."""

    def __post_init__(self) -> None:
        """It has something to do, and what that needs."""
        if self.pad is None and not self.has_topics:
            raise FieldError("pad: there is no [pad], no [[to_ledger]], no [[from_ledger]]; there is nothing to do")
        if self.has_topics and (self.bridge is None or self.spool is None):
            raise FieldError("bridge and spool: with [[to_ledger]] or [[from_ledger]] both are needed")

    @property
    def has_topics(self) -> bool:
        """Whether topics go to the ledger or come from it."""
        return bool(self.to_ledger or self.from_ledger)

    @property
    def node(self) -> str:
        """The node's full name."""
        return self.pad.node if self.pad is not None else f"/wonderland/{wire.as_name(self.bridge or '')}"


def load(path: Path) -> Settings:
    """The settings of a file. Raises SettingsError."""
    return load_toml(path, Settings)
