"""What a node tells its owner: measurements, data, states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from wonderland_fira_uci.uci.status import SessionState


class RangeMeasurement(NamedTuple):
    """One range that this node measured to one peer in one round.

    ``t_ms``: arrival on the node's clock. ``range_mm`` is None unless ``status`` is OK (0). Nodes report whole
    centimetres. ``nlos``: True obstructed, False clear, None not known. ``rssi_dbm`` is None where not reported.
    ``sequence`` counts this node's reports; nothing aligns it with another node's.
    """

    t_ms: int
    session_id: int
    sequence: int
    peer_mac: int
    status: int
    range_mm: int | None
    nlos: bool | None
    rssi_dbm: float | None


class FrameStamped(NamedTuple):
    """One frame of a tag as this node time-stamped it, on the clock that the pad's nodes share (uplink TDoA).

    ``t_ms``: arrival of the report on the node's clock. ``ticks``: 15.65 ps each, of a counter of 40 bits. ``number``:
    the tag's count of its frames, the same at every node. ``payload``: what the tag's host put into it.
    """

    t_ms: int
    session_id: int
    tag_mac: int
    number: int
    ticks: int
    nlos: bool | None
    payload: bytes


@dataclass(frozen=True, slots=True)
class RangingSilent:
    """A round in which the node heard nobody (a report without records)."""

    t_ms: int
    session_id: int
    sequence: int


@dataclass(frozen=True, slots=True)
class DataReceived:
    """In-band data of the peer ``source_mac``; may hold several frames of the sender, concatenated."""

    t_ms: int
    session_id: int
    source_mac: int
    data: bytes


@dataclass(frozen=True, slots=True)
class DataFailed:
    """The node says that data could not be sent; ``status`` is a ``TransferStatus`` octet. The link repeats."""

    t_ms: int
    session_id: int
    sequence: int
    status: int


@dataclass(frozen=True, slots=True)
class SessionStateChanged:
    """The node's own state of the session; ``reason`` is the octet of SESSION_STATUS_NTF (0: by command)."""

    t_ms: int
    session_id: int
    state: SessionState
    reason: int


@dataclass(frozen=True, slots=True)
class SessionInterrupted:
    """The node vanished or rebooted; the session is being set up again and ACTIVE will follow."""

    t_ms: int
    session_id: int
    detail: str


@dataclass(frozen=True, slots=True)
class SessionFailed:
    """The session is over: the node refuses it, however often one asks."""

    t_ms: int
    session_id: int
    error: Exception


SessionEvent = (
    RangeMeasurement
    | FrameStamped
    | RangingSilent
    | DataReceived
    | DataFailed
    | SessionStateChanged
    | SessionInterrupted
    | SessionFailed
)
