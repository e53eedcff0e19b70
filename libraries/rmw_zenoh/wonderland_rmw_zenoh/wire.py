"""Names and small frames of rmw_zenoh: keys of data, tokens of the graph, quality of service, attachments. Pure."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final, Literal

from wonderland_rmw_zenoh.errors import WireError

ADMIN: Final = "@ros2_lv"
"""With which the tokens of the graph begin."""
MAX_DOMAIN: Final = 232
MAX_NAME: Final = 255
GID_BYTES: Final = 16
ATTACHMENT: Final = struct.Struct(f"<qqB{GID_BYTES}s")
_NAME: Final = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
_TYPE: Final = re.compile(r"[a-z][a-z0-9_]*/(?:msg|srv|action)/[A-Za-z][A-Za-z0-9_]*")
_DDS: Final = re.compile(r"([a-z][a-z0-9_]*)::(msg|srv|action)::dds_::([A-Za-z][A-Za-z0-9_]*)_")
_HASH: Final = re.compile(r"RIHS01_[0-9a-f]{64}")

Kind = Literal["NN", "MP", "MS", "SS", "SC"]
"""Node, publisher, subscription, service and client."""


def is_name(name: str) -> bool:
    """Whether this is the full name of a topic, a service or a node, as ROS 2 allows it."""
    return len(name) <= MAX_NAME and _NAME.fullmatch(name) is not None


def is_type(name: str) -> bool:
    """Whether this is ``package/msg/Type`` (or ``srv``, ``action``)."""
    return len(name) <= MAX_NAME and _TYPE.fullmatch(name) is not None


def is_hash(text: str) -> bool:
    """Whether this is a type hash of version 1."""
    return _HASH.fullmatch(text) is not None


def as_name(text: str) -> str:
    """Any text as one part of a name: what ROS 2 does not allow becomes ``_``."""
    made = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in text)
    return made if made[:1].isalpha() else f"_{made}"


def dds_type(name: str) -> str:
    """``std_msgs/msg/String`` → ``std_msgs::msg::dds_::String_``. Raises WireError."""
    if not is_type(name):
        raise WireError(f"{name[:100]!r} is no type of ROS 2 (package/msg/Type)")
    package, kind, of = name.split("/")
    return f"{package}::{kind}::dds_::{of}_"


def ros_type(name: str) -> str:
    """The inverse of ``dds_type``. Raises WireError."""
    found = _DDS.fullmatch(name)
    if found is None or len(name) > MAX_NAME:
        raise WireError(f"{name[:100]!r} is no type of ROS 2 as rmw_zenoh writes it")
    return "/".join(found.groups())


def data_key(domain: int, name: str, kind: str, type_hash: str) -> str:
    """Under which messages or calls travel. Raises WireError."""
    if not is_name(name):
        raise WireError(f"{name[:100]!r} is no name of ROS 2 (/like/this)")
    return f"{domain}/{name[1:]}/{dds_type(kind)}/{type_hash}"


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service, as far as it means something here. Depth 0: all are kept."""

    reliable: bool = True
    transient_local: bool = False
    depth: int = 10

    def text(self) -> str:
        """As a token has it: what is usual is left out."""
        history = f",{self.depth}" if self.depth else "2,"
        return f"{'' if self.reliable else 2}:{1 if self.transient_local else ''}:{history}:,:,:,,"


STATE: Final = Qos(transient_local=True, depth=1)
"""Who comes later gets the last one."""
STATIC_TF: Final = Qos(transient_local=True, depth=1)
SENSOR: Final = Qos(reliable=False, depth=5)


def parse_qos(text: str) -> Qos:
    """What a token says. Raises WireError."""
    parts = text.split(":")
    history = parts[2].split(",") if len(parts) == 6 else []
    if len(history) != 2 or not (parts[0] + parts[1] + history[0] + history[1] + "0").isdigit() or len(text) > 200:
        raise WireError(f"{text[:60]!r} is no quality of service as rmw_zenoh writes it")
    depth = 0 if history[0] == "2" else int(history[1] or 10)
    return Qos(reliable=parts[0] != "2", transient_local=parts[1] == "1", depth=min(depth, 1_000_000))


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A node, or what it offers or hears; a token says that it is there."""

    domain: int
    zid: str
    node_id: int
    id: int
    kind: Kind
    node: str
    """Full name, ``/namespace/name``."""
    name: str = ""
    """Of the topic or the service; empty for a node itself."""
    type: str = ""
    type_hash: str = ""
    qos: Qos = Qos()

    def token(self) -> str:
        """Its key in the graph."""
        space, _, own = self.node.rpartition("/")
        whose = (
            f"{ADMIN}/{self.domain}/{self.zid}/{self.node_id}/{self.id}/{self.kind}/%/{_mangled(space or '/')}/{own}"
        )
        if self.kind == "NN":
            return whose
        return f"{whose}/{_mangled(self.name)}/{dds_type(self.type)}/{self.type_hash}/{self.qos.text()}"


def parse_token(key: str) -> Endpoint:
    """The endpoint of a token; its type may be one that nobody here knows. Raises WireError."""
    parts = key.split("/") if len(key) <= 2_000 else []
    try:
        if parts[0] != ADMIN or len(parts) != (9 if parts[5] == "NN" else 13):
            raise WireError(f"{key[:100]!r} is no token of rmw_zenoh")
        space, own = _plain(parts[7]), _plain(parts[8]).lstrip("/")
        node = f"{space.rstrip('/')}/{own}"
        ids = int(parts[1]), parts[2], int(parts[3]), int(parts[4])
        if parts[5] == "NN":
            return Endpoint(*ids, "NN", node)
        kinds: dict[str, Kind] = {"MP": "MP", "MS": "MS", "SS": "SS", "SC": "SC"}
        name = _plain(parts[9])
        if not is_name(name):
            raise WireError(f"{name[:100]!r} is no name of ROS 2")
        return Endpoint(
            *ids,
            kinds[parts[5]],
            node,
            name,
            ros_type(parts[10]),
            parts[11] if is_hash(parts[11]) else "",
            parse_qos(parts[12]),
        )
    except (IndexError, KeyError, ValueError) as cause:
        raise WireError(f"{key[:100]!r} is no token of rmw_zenoh") from cause


@dataclass(frozen=True, slots=True)
class Attachment:
    """What goes beside each message: its number, when it was sent (ns since the epoch), and by whom."""

    seq: int
    t_ns: int
    gid: bytes

    def encode(self) -> bytes:
        """33 bytes."""
        return ATTACHMENT.pack(self.seq, self.t_ns, GID_BYTES, self.gid)


def parse_attachment(data: bytes | None) -> Attachment:
    """Raises WireError: a message without a proper one is none of ROS 2's."""
    if data is None or len(data) != ATTACHMENT.size or data[16] != GID_BYTES:
        found = "none" if data is None else f"one of {len(data)} bytes"
        raise WireError(
            f"attachment: {found}, where rmw_zenoh has {ATTACHMENT.size} bytes (number, time, sender); is the peer "
            "older than rmw_zenoh 0.2.4, or no ROS 2 at all?"
        )
    seq, t_ns, _, gid = ATTACHMENT.unpack(data)
    return Attachment(seq, t_ns, gid)


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _plain(name: str) -> str:
    return name.replace("%", "/")
