"""What the host-side state machine of a node reports."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland_fira_uci.uci.codec import MalformedMessage
from wonderland_fira_uci.uci.data import DataReceive, DataTransferStatus
from wonderland_fira_uci.uci.errors import UciError
from wonderland_fira_uci.uci.ranging import RangeData
from wonderland_fira_uci.uci.session import DeviceInfo
from wonderland_fira_uci.uci.session_machine import StateChanged


@dataclass(frozen=True, slots=True)
class DeviceReady:
    """The node was reset and answers. ``info`` is None when it does not describe itself."""

    info: DeviceInfo | None


@dataclass(frozen=True, slots=True)
class DeviceLost:
    """The node stopped answering or its port is gone; the text says which."""

    detail: str


@dataclass(frozen=True, slots=True)
class StreamResynchronised:
    """Octets on the line made no sense and were thrown away."""

    octets: int


@dataclass(frozen=True, slots=True)
class SessionChanged:
    """A session's state on the node changed (``change.state`` None: the node does not have it)."""

    session_id: int
    change: StateChanged


@dataclass(frozen=True, slots=True)
class SessionLost:
    """The node lost the session; it is being set up again."""

    session_id: int
    detail: str


@dataclass(frozen=True, slots=True)
class SessionEnded:
    """A session is gone: closed as asked (``error`` None) or refused by the node."""

    session_id: int
    error: UciError | None


@dataclass(frozen=True, slots=True)
class CreditGranted:
    """``send_data`` will be taken for this session."""

    session_id: int


@dataclass(frozen=True, slots=True)
class SessionMessage:
    """A report, data or transfer status of a session."""

    session_id: int
    message: RangeData | DataReceive | DataTransferStatus


DeviceEvent = (
    DeviceReady
    | DeviceLost
    | StreamResynchronised
    | SessionChanged
    | SessionLost
    | SessionEnded
    | CreditGranted
    | SessionMessage
    | MalformedMessage
)
