"""Packets of UCI: headers, segmentation, reassembly, and what to do with garbage. Sans-I/O.

Source: FiRa UCI, "Control packets" and "Data packets". A control packet begins with
``message type (3 bits) | packet boundary flag (1) | group (4)``, ``opcode``, 0, ``length (8)``; a data packet with
``0 | packet boundary flag | data packet format (4)``, 0, ``length (16, little-endian)``. The flag says that more
segments of the same message follow.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, Literal

from wonderland_fira_uci.uci.errors import UciEncodeError

HEADER_OCTETS: Final = 4
MAX_CONTROL_PAYLOAD: Final = 255
MAX_DATA_PAYLOAD: Final = 4096
MAX_MESSAGE_OCTETS: Final = 65_536
MAX_OPEN_MESSAGES: Final = 8
BOUNDARY: Final = 0x10

Side = Literal["host", "device"]


class MessageType(IntEnum):
    """First three bits of a packet."""

    DATA = 0
    COMMAND = 1
    RESPONSE = 2
    NOTIFICATION = 3


class Group(IntEnum):
    """Group ids of control packets (GID)."""

    CORE = 0
    SESSION_CONFIG = 1
    SESSION_CONTROL = 2
    DATA_CONTROL = 3


class DataFormat(IntEnum):
    """Data packet formats (DPF)."""

    SEND = 1
    RECEIVE = 2


Packet = tuple[int, int, bytes]
"""First octet without the boundary flag, second octet, whole payload."""


def encode_control(message_type: MessageType, group: int, opcode: int, payload: bytes = b"") -> bytes:
    """One control message as one packet, or several with boundary flags when the payload exceeds 255 octets."""
    if not 0 <= group <= 0x0F or not 0 <= opcode <= 0x3F:
        raise UciEncodeError(f"group {group} or opcode {opcode} is out of range")
    first = message_type << 5 | group
    if len(payload) <= MAX_CONTROL_PAYLOAD:
        return bytes((first, opcode, 0, len(payload))) + payload
    if len(payload) > MAX_MESSAGE_OCTETS:
        raise UciEncodeError(f"a control message of {len(payload)} octets; at most {MAX_MESSAGE_OCTETS} are allowed")
    out = bytearray()
    for at in range(0, len(payload), MAX_CONTROL_PAYLOAD):
        part = payload[at : at + MAX_CONTROL_PAYLOAD]
        more = BOUNDARY if at + len(part) < len(payload) else 0
        out += bytes((first | more, opcode, 0, len(part))) + part
    return bytes(out)


def encode_data(data_format: DataFormat, payload: bytes, limit: int = MAX_DATA_PAYLOAD) -> bytes:
    """One data message as one packet, or several with boundary flags where the node takes ``limit`` octets in each.

    Raises ``UciEncodeError`` above 4096 octets.
    """
    if len(payload) > MAX_DATA_PAYLOAD:
        raise UciEncodeError(f"a data packet of {len(payload)} octets; at most {MAX_DATA_PAYLOAD} are allowed")
    out = bytearray()
    for at in range(0, len(payload), max(limit, 1)) or range(1):
        part = payload[at : at + max(limit, 1)]
        more = BOUNDARY if at + len(part) < len(payload) else 0
        out += bytes((data_format | more, 0, *len(part).to_bytes(2, "little"))) + part
    return bytes(out)


class PacketReader:
    """Cuts a byte stream into packets; ``side`` is the side that *reads*: a host hears responses, never commands.

    An impossible header means that the stream has lost its framing. The reader then discards everything, and
    ``desynchronised`` is true, until its owner calls ``reset`` once the line has been quiet for a moment. It does not
    hunt for the next plausible header: payloads hold what the peer's radio sent, so hunting inside one would let
    that peer write packets into this node's mouth. A header longer than its body leaves ``incomplete`` true; after a
    timeout the owner calls ``reset`` as well.
    """

    def __init__(self, side: Side) -> None:
        heard = (MessageType.RESPONSE, MessageType.NOTIFICATION) if side == "host" else (MessageType.COMMAND,)
        self._format = DataFormat.RECEIVE if side == "host" else DataFormat.SEND
        self._valid = frozenset(
            [t << 5 | more | group for t in heard for more in (0, BOUNDARY) for group in range(16)]
            + [self._format, self._format | BOUNDARY]
        )
        self._buffer = b""
        self._packets: list[Packet] = []
        self._open: dict[tuple[int, int], bytearray] = {}
        self._discarded = 0
        self.desynchronised = False

    @property
    def incomplete(self) -> bool:
        """Whether the beginning of a packet or of a segmented message waits for the rest."""
        return bool(self._buffer) or bool(self._open)

    def receive_data(self, data: bytes) -> None:
        """Takes octets as they came."""
        if self.desynchronised:
            self._discarded += len(data)
            return
        buffer = self._buffer + data if self._buffer else data
        end = len(buffer)
        valid, packets = self._valid, self._packets
        at = 0
        while at + HEADER_OCTETS <= end:
            first = buffer[at]
            second = buffer[at + 1]
            if first >= 0x20:
                length = buffer[at + 3]
                if first not in valid or second > 0x3F or buffer[at + 2]:
                    self._lose(end - at)
                    return
            else:
                length = buffer[at + 2] | buffer[at + 3] << 8
                if first not in valid or second or length > MAX_DATA_PAYLOAD:
                    self._lose(end - at)
                    return
            stop = at + HEADER_OCTETS + length
            if stop > end:
                break
            payload = buffer[at + HEADER_OCTETS : stop]
            if first & BOUNDARY or self._open:
                if not self._segment(first, second, payload):
                    self._lose(end - at)
                    return
            else:
                packets.append((first, second, payload))
            at = stop
        self._buffer = buffer[at:]

    def _segment(self, first: int, second: int, payload: bytes) -> bool:
        key = (first & ~BOUNDARY, second)
        message = self._open.get(key)
        if message is None:
            if not first & BOUNDARY:
                self._packets.append((first, second, payload))
                return True
            if len(self._open) >= MAX_OPEN_MESSAGES:
                return False
            message = self._open[key] = bytearray()
        message += payload
        if len(message) > MAX_MESSAGE_OCTETS:
            return False
        if not first & BOUNDARY:
            del self._open[key]
            self._packets.append((key[0], second, bytes(message)))
        return True

    def _lose(self, octets: int) -> None:
        self._discarded += octets
        self._buffer = b""
        self._open.clear()
        self.desynchronised = True

    def packets(self) -> list[Packet]:
        """Whole messages since the last call."""
        out = self._packets
        self._packets = []
        return out

    def reset(self) -> int:
        """Forgets what is unfinished and starts afresh; the number of octets thrown away since the last reset."""
        discarded = self._discarded + len(self._buffer) + sum(map(len, self._open.values()))
        self._discarded = 0
        self._buffer = b""
        self._open.clear()
        self.desynchronised = False
        return discarded
