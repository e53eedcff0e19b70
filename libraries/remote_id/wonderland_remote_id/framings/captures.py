"""Capture files, pcap, pcapng and btsnoop, as a stream: bytes in, packets out, and the Remote ID frames in them.

Read are captures of Wi-Fi in monitor mode (link types 105 IEEE 802.11, 127 radiotap, 192 PPI), of Bluetooth sniffers
(251 link layer, 256 with the sniffer's header, 272 Nordic) and of host controllers (187 H4, 201 H4 with direction, 254
Linux monitor; btsnoop as btmon and Android write it). A packet that is no Remote ID gives nothing; one that is and is
broken gives an error, and reading goes on. So it does past an interface that can hold none, with one error for it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from wonderland_remote_id.errors import FramingError
from wonderland_remote_id.framings import ble, wifi
from wonderland_remote_id.framings.framed import Framed

MAX_PACKET_BYTES: Final = 262_144
MAX_BLOCK_BYTES: Final = MAX_PACKET_BYTES + 65_536
MAX_INTERFACES: Final = 256

HCI_H4, HCI_H4_DIRECTION, HCI_MONITOR, BLE_LINK_LAYER, BLE_SNIFFER, BLE_NORDIC = 187, 201, 254, 251, 256, 272
WIFI, WIFI_RADIOTAP, WIFI_PPI = 105, 127, 192

_MAGIC: Final = {
    b"\xd4\xc3\xb2\xa1": ("<", 1_000_000),
    b"\xa1\xb2\xc3\xd4": (">", 1_000_000),
    b"\x4d\x3c\xb2\xa1": ("<", 1_000_000_000),
    b"\xa1\xb2\x3c\x4d": (">", 1_000_000_000),
}
_SECTION, _INTERFACE, _OBSOLETE_PACKET, _SIMPLE_PACKET, _ENHANCED_PACKET = 0x0A0D0D0A, 1, 2, 3, 6
_SECTION_MAGIC: Final = b"\x0a\x0d\x0d\x0a"
_RESOLUTION_OPTION: Final = 9
_BTSNOOP_MAGIC: Final = b"btsnoop\0"
_BTSNOOP_EPOCH_US: Final = 0x00DCDDB30F2F8000
"""Btsnoop counts microseconds from the year 0."""
_SNOOP_H1, _SNOOP_H4, _SNOOP_MONITOR = 1001, 1002, 2001
_MONITOR_EVENT: Final = 3
_H4_EVENT: Final = b"\x04"
_NORDIC_BYTES, _NORDIC_INNER_BYTES = 17, 10


class CaptureError(FramingError):
    """A file that is no capture, or whose structure is lost: what follows cannot be read."""


@dataclass(frozen=True, slots=True)
class Packet:
    """One captured packet: ``number`` counts from 1, ``t_ms`` is Unix time (None where the file has none).

    ``interface`` counts the interfaces of the whole file.
    """

    number: int
    link_type: int
    t_ms: int | None
    data: bytes
    interface: int = 0


class CaptureReader:
    """Takes a capture in pieces of any size; ``feed`` gives the packets that are complete.

    >>> reader = CaptureReader()
    >>> for packet in reader.feed(data): ...
    >>> reader.finish()  # raises where the file ends within a packet
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._step: Callable[[], Iterator[Packet] | None] = self._begin
        self._order = "<"
        self._ticks = 1_000_000
        self._link_type = -1
        self._interfaces: list[tuple[int, int, int]] = []
        self._described = 0
        self._count = 0

    def feed(self, data: bytes) -> Iterator[Packet]:
        """The packets that these bytes complete. Raises `CaptureError` where the file's structure is lost."""
        self._buffer += data
        while (packets := self._step()) is not None:
            yield from packets

    def finish(self) -> None:
        """Say that the file is at its end. Raises `CaptureError` where it ends too early."""
        if self._buffer or self._step == self._begin:
            raise CaptureError(f"the capture ends within a packet or header ({len(self._buffer)} bytes are left)")

    def _take(self, size: int) -> bytes | None:
        if len(self._buffer) < size:
            return None
        taken = bytes(self._buffer[:size])
        del self._buffer[:size]
        return taken

    def _begin(self) -> Iterator[Packet] | None:
        if len(self._buffer) < 4:
            return None
        magic = bytes(self._buffer[:4])
        if magic == _SECTION_MAGIC:
            self._step = self._block
            return iter(())
        if _BTSNOOP_MAGIC.startswith(magic):
            return self._begin_btsnoop()
        if magic not in _MAGIC:
            raise CaptureError(f"begins with {magic.hex()}: no pcap, pcapng or btsnoop file (compressed?)")
        header = self._take(24)
        if header is None:
            return None
        self._order, self._ticks = _MAGIC[magic]
        self._link_type = int(struct.unpack_from(f"{self._order}I", header, 20)[0]) & 0xFFFF
        _check_link_type(self._link_type)
        self._step = self._record
        return iter(())

    def _record(self) -> Iterator[Packet] | None:
        if len(self._buffer) < 16:
            return None
        seconds, fraction, size, _ = struct.unpack_from(f"{self._order}IIII", self._buffer)
        if size > MAX_PACKET_BYTES:
            raise CaptureError(f"packet {self._count + 1} announces {size} bytes; the file is damaged here")
        whole = self._take(16 + size)
        if whole is None:
            return None
        return self._packet(self._link_type, seconds * 1000 + fraction * 1000 // self._ticks, whole[16:])

    def _packet(self, link_type: int, t_ms: int | None, data: bytes, interface: int = 0) -> Iterator[Packet]:
        self._count += 1
        return iter((Packet(self._count, link_type, t_ms, data, interface),))

    def _begin_btsnoop(self) -> Iterator[Packet] | None:
        header = self._take(16)
        if header is None:
            return None
        version, self._link_type = struct.unpack_from(">II", header, 8)
        if not header.startswith(_BTSNOOP_MAGIC) or version != 1:
            raise CaptureError(f"a btsnoop file of version {version}; 1 is known")
        if self._link_type not in {_SNOOP_H1, _SNOOP_H4, _SNOOP_MONITOR}:
            raise CaptureError(f"a btsnoop file of type {self._link_type}; write it with btmon -w")
        self._step = self._snooped
        return iter(())

    def _snooped(self) -> Iterator[Packet] | None:
        """A record: lengths, flags, drops, time; in a monitor's file the flags hold what the packet is."""
        if len(self._buffer) < 24:
            return None
        _, size, flags, _, t_us = struct.unpack_from(">IIIIq", self._buffer)
        if size > MAX_PACKET_BYTES:
            raise CaptureError(f"packet {self._count + 1} announces {size} bytes; the file is damaged here")
        whole = self._take(24 + size)
        if whole is None:
            return None
        t_ms, data = (t_us - _BTSNOOP_EPOCH_US) // 1000, whole[24:]
        if self._link_type == _SNOOP_MONITOR:
            return self._packet(HCI_MONITOR, t_ms, struct.pack(">HH", flags >> 16, flags & 0xFFFF) + data)
        if self._link_type == _SNOOP_H1:  # without a type: the flags say that it is an event, and received
            data = _H4_EVENT + data if flags & 3 == 3 else b""
        return self._packet(HCI_H4, t_ms, data)

    def _block(self) -> Iterator[Packet] | None:
        if len(self._buffer) < 12:
            return None
        if self._buffer[:4] == _SECTION_MAGIC:
            magic = bytes(self._buffer[8:12])
            if magic not in {b"\x4d\x3c\x2b\x1a", b"\x1a\x2b\x3c\x4d"}:
                raise CaptureError("a section header without its byte-order magic; the file is damaged here")
            self._order = "<" if magic[0] == 0x4D else ">"
        kind, length = struct.unpack_from(f"{self._order}II", self._buffer)
        if not 12 <= length <= MAX_BLOCK_BYTES or length % 4:
            raise CaptureError(f"a block of {length} bytes; the file is damaged here")
        block = self._take(length)
        if block is None:
            return None
        if struct.unpack_from(f"{self._order}I", block, length - 4)[0] != length:
            raise CaptureError("a block whose two lengths differ; the file is damaged here")
        try:
            return self._contents(kind, block[8:-4])
        except struct.error:
            raise CaptureError(f"a block of type {kind} that is too short for its fields") from None

    def _contents(self, kind: int, body: bytes) -> Iterator[Packet]:
        order = self._order
        if kind == _SECTION:
            self._interfaces.clear()
        elif kind == _INTERFACE:
            link_type = struct.unpack_from(f"{order}H", body)[0]
            if len(self._interfaces) >= MAX_INTERFACES:
                raise CaptureError(f"more than {MAX_INTERFACES} interfaces in one section")
            self._interfaces.append((link_type, self._resolution(body[8:]), self._described))
            self._described += 1
        elif kind in {_ENHANCED_PACKET, _OBSOLETE_PACKET}:
            if kind == _ENHANCED_PACKET:
                index, high, low, size = struct.unpack_from(f"{order}IIII", body)
            else:
                index, _, high, low, size = struct.unpack_from(f"{order}HHIII", body)
            link_type, ticks, interface = self._interface(index)
            if 20 + size > len(body):
                raise CaptureError(f"packet {self._count + 1} has {size} bytes in a block of {len(body)}")
            return self._packet(link_type, (high << 32 | low) * 1000 // ticks, body[20 : 20 + size], interface)
        elif kind == _SIMPLE_PACKET:
            link_type, _, interface = self._interface(0)
            size = min(struct.unpack_from(f"{order}I", body)[0], len(body) - 4)
            return self._packet(link_type, None, body[4 : 4 + size], interface)
        return iter(())

    def _interface(self, index: int) -> tuple[int, int, int]:
        if index >= len(self._interfaces):
            raise CaptureError(f"packet {self._count + 1} is of interface {index}, which the file does not describe")
        return self._interfaces[index]

    def _resolution(self, options: bytes) -> int:
        """Ticks a second, from the interface's options (``if_tsresol``); a million where it says nothing."""
        at = 0
        while at + 4 <= len(options):
            code, length = struct.unpack_from(f"{self._order}HH", options, at)
            if code == 0:
                break
            if code == _RESOLUTION_OPTION and length >= 1 and at + 4 < len(options):
                value = options[at + 4]
                return 1 << (value & 0x7F) if value & 0x80 else int(10 ** min(value, 18))
            at += 4 + (length + 3) // 4 * 4
        return 1_000_000


def _check_link_type(link_type: int) -> None:
    if link_type not in _UNWRAP:
        raise CaptureError(_unknown(link_type))


def _unknown(link_type: int) -> str:
    known = ", ".join(str(known) for known in sorted(_UNWRAP))
    return (
        f"link type {link_type} holds no Remote ID that can be read here; known are {known} "
        "(capture Wi-Fi in monitor mode, Bluetooth with a sniffer or btmon)"
    )


class Unwrapper:
    """The Remote ID frames in the packets of one capture."""

    def __init__(self) -> None:
        self._hci = ble.HciEvents()
        self._passed_over: set[int] = set()

    def frames(self, packet: Packet) -> list[Framed]:
        """The frames in a packet, with its time.

        Raises `FramingError` for Remote ID that is broken, and once for an interface that can hold none.
        """
        unwrap = _UNWRAP.get(packet.link_type)
        if unwrap is None:
            if packet.interface in self._passed_over:
                return []
            self._passed_over.add(packet.interface)
            raise FramingError(f"interface {packet.interface} is passed over: {_unknown(packet.link_type)}")
        return [replace(framed, t_ms=packet.t_ms) for framed in unwrap(self, packet.data)]

    def _wifi(self, data: bytes) -> list[Framed]:
        return wifi.parse_packet(data)

    def _radiotap(self, data: bytes) -> list[Framed]:
        return wifi.parse_radiotap(data)

    def _ble(self, data: bytes) -> list[Framed]:
        return ble.parse_link_layer(data)

    def _ble_sniffer(self, data: bytes) -> list[Framed]:
        """The header of link type 256: channel, signal, noise, offences, access address, flags."""
        if len(data) < 10:
            raise FramingError(f"a sniffer's header of {len(data)} bytes; it has 10")
        _, signal, _, _, _, flags = struct.unpack_from("<BbbBIH", data)
        packet = data[10:]
        if flags >> 14 == 2:  # the coded PHY: an octet with the coding follows the access address
            packet = packet[:4] + packet[5:]
        found = ble.parse_link_layer(packet, crc_checked=bool(flags & 0x0C00 == 0x0C00))
        if found and flags & 0x0C00 == 0x0400:
            raise FramingError("the packet's CRC is wrong: it was not heard well")
        return [replace(framed, rssi_dbm=signal if flags & 0x02 and signal <= 20 else None) for framed in found]

    def _hci_h4(self, data: bytes) -> list[Framed]:
        return self._hci.feed(data)

    def _hci_direction(self, data: bytes) -> list[Framed]:
        return self._hci.feed(data[4:])

    def _hci_monitor(self, data: bytes) -> list[Framed]:
        """Adapter and opcode, then the packet without its H4 type: only events are of interest."""
        is_event = data[2:4] == _MONITOR_EVENT.to_bytes(2, "big")
        return self._hci.feed(_H4_EVENT + data[4:]) if is_event else []

    def _ppi(self, data: bytes) -> list[Framed]:
        """Per-packet information: version, flags, length, the link type of what follows it."""
        if len(data) < 8:
            raise FramingError(f"{len(data)} bytes are no PPI header")
        version, _, length, link_type = struct.unpack_from("<BBHI", data)
        if version != 0 or not 8 <= length <= len(data):
            raise FramingError(f"a PPI header of version {version} and {length} bytes, of {len(data)}")
        if link_type == WIFI:
            return wifi.parse_packet(data[length:])
        return ble.parse_link_layer(data[length:]) if link_type == BLE_LINK_LAYER else []

    def _nordic(self, data: bytes) -> list[Framed]:
        """Nordic's header: board, UART header (6), then its own length (10), flags, channel, signal, counter, time."""
        if len(data) < _NORDIC_BYTES or data[7] != _NORDIC_INNER_BYTES:
            return []  # a ping, or the protocol of before 2016
        flags, signal = data[8], data[10]
        packet = data[_NORDIC_BYTES:]
        if flags >> 4 & 7 == 2:  # the coded PHY: an octet with the coding follows the access address
            packet = packet[:4] + packet[5:]
        found = ble.parse_link_layer(packet, crc_checked=bool(flags & 1))
        if found and not flags & 1:
            raise FramingError("the packet's CRC is wrong: it was not heard well")
        return [replace(framed, rssi_dbm=-signal if signal else None) for framed in found]


_UNWRAP: Final[dict[int, Callable[[Unwrapper, bytes], list[Framed]]]] = {
    HCI_H4: Unwrapper._hci_h4,  # noqa: SLF001 - the table stands outside only so that the link types stand in one place
    HCI_H4_DIRECTION: Unwrapper._hci_direction,  # noqa: SLF001
    HCI_MONITOR: Unwrapper._hci_monitor,  # noqa: SLF001
    WIFI: Unwrapper._wifi,  # noqa: SLF001
    WIFI_RADIOTAP: Unwrapper._radiotap,  # noqa: SLF001
    WIFI_PPI: Unwrapper._ppi,  # noqa: SLF001
    BLE_LINK_LAYER: Unwrapper._ble,  # noqa: SLF001
    BLE_SNIFFER: Unwrapper._ble_sniffer,  # noqa: SLF001
    BLE_NORDIC: Unwrapper._nordic,  # noqa: SLF001
}


def pcap_header(link_type: int) -> bytes:
    """The header of a pcap file with times in microseconds."""
    return struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, MAX_PACKET_BYTES, link_type)


def pcap_record(data: bytes, t_ms: int) -> bytes:
    """One packet of a pcap file."""
    return struct.pack("<IIII", t_ms // 1000 & 0xFFFFFFFF, t_ms % 1000 * 1000, len(data), len(data)) + data
