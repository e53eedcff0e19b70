"""Bluetooth Low Energy: Remote ID as service data of the 16-bit UUID 0xFFFA (ASTM F3411-22a, 5.4.6).

Service data = application code 0x0D, message counter, frame. Legacy advertising (Bluetooth 4) carries one message of 25
bytes, extended advertising (Bluetooth 5, also on the coded PHY, "Long Range") a pack. Three forms come in: advertising
data (from BlueZ or any scanner), packets of the link layer (sniffers, captures), events of the host controller.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import Final

from wonderland_remote_id.decoding import MAX_FRAME_BYTES
from wonderland_remote_id.errors import FramingError
from wonderland_remote_id.framings.framed import Framed, format_address, parse_address
from wonderland_remote_id.messages import MESSAGE_BYTES

SERVICE_UUID: Final = "0000fffa-0000-1000-8000-00805f9b34fb"
APPLICATION_CODE: Final = 0x0D
MAX_ADVERTISING_BYTES: Final = 1650
"""The longest advertising data that Bluetooth allows, over all fragments."""

_SERVICE_DATA: Final = b"\x16\xfa\xff"
_ACCESS_ADDRESS: Final = 0x8E89BED6
_HEADER_BYTES: Final = 6
_CRC_BYTES: Final = 3
_CRC_INIT: Final = 0xAAAAAA  # 0x555555, its bits in the order of transmission
_CRC_POLYNOMIAL: Final = 0xDA6000
_ADV_EXT_IND: Final = 7
_LEGACY: Final = frozenset({0, 2, 6})  # ADV_IND, ADV_NONCONN_IND, ADV_SCAN_IND
_EXTENDED_FIELDS: Final = ((0x01, 6), (0x02, 6), (0x04, 1), (0x08, 2), (0x10, 3), (0x20, 18), (0x40, 1))
_MAX_PENDING: Final = 64


def service_data(frame: bytes, counter: int) -> bytes:
    """The service data that carries a frame, without its length and UUID."""
    return bytes((APPLICATION_CODE, counter & 0xFF)) + frame


def advertising_data(frame: bytes, counter: int) -> bytes:
    """The advertising data (one AD structure) that carries a frame. Raises `FramingError` for one that is too long."""
    body = _SERVICE_DATA + service_data(frame, counter)
    if len(frame) > MAX_FRAME_BYTES:
        raise FramingError(f"a frame of {len(frame)} bytes; one has at most {MAX_FRAME_BYTES}")
    return bytes((len(body),)) + body


def parse_service_data(data: bytes) -> Framed | None:
    """The frame in the service data of UUID 0xFFFA; None where it is another application's. Raises `FramingError`."""
    if not data or data[0] != APPLICATION_CODE:
        return None
    if len(data) < 2 + MESSAGE_BYTES:
        raise FramingError(f"service data of {len(data)} bytes; counter and message have {2 + MESSAGE_BYTES}")
    frame = data[2:]
    return Framed(frame, "ble4" if len(frame) == MESSAGE_BYTES else "ble5", counter=data[1])


def parse_advertising_data(data: bytes) -> list[Framed]:
    """The frames in advertising data; empty where it holds no Remote ID. Raises `FramingError`."""
    if len(data) > MAX_ADVERTISING_BYTES:
        raise FramingError(f"advertising data of {len(data)} bytes; there are at most {MAX_ADVERTISING_BYTES}")
    found = []
    for structure in _structures(data):
        if structure.startswith(_SERVICE_DATA):
            framed = parse_service_data(structure[len(_SERVICE_DATA) :])
            if framed is not None:
                found.append(framed)
    return found


def _structures(data: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        length = data[at]
        if length == 0:  # the rest is filling
            return
        if at + 1 + length > len(data):
            # What is cut off only matters where it is ours.
            if data[at + 1 : at + 1 + len(_SERVICE_DATA)] == _SERVICE_DATA:
                raise FramingError(f"an AD structure of {length} bytes, of which {len(data) - at - 1} are there")
            return
        yield data[at + 1 : at + 1 + length]
        at += 1 + length


# --- the link layer ------------------------------------------------------------------------------------------------


def link_layer_packet(frame: bytes, counter: int, address: str, *, extended: bool = False) -> bytes:
    """A packet of the link layer: ADV_NONCONN_IND, or AUX_ADV_IND with ``extended``. Raises `FramingError`.

    ``address`` is taken as a random one, as drones use them.
    """
    try:
        advertiser = parse_address(address)[::-1]
    except ValueError:
        raise FramingError(f"{address!r:.40} is no address, for example c0:ff:ee:00:00:01") from None
    data = advertising_data(frame, counter)
    if extended:
        payload = bytes((7, 0x01)) + advertiser + data  # 7 bytes of extended header: its flags and the address
        header = bytes((_ADV_EXT_IND | 0x40, len(payload)))
    else:
        if len(data) > 31:
            raise FramingError(f"legacy advertising holds 31 bytes, not {len(data)}: send packs with extended=True")
        payload = advertiser + data
        header = bytes((2 | 0x40, len(payload)))
    pdu = header + payload
    return _ACCESS_ADDRESS.to_bytes(4, "little") + pdu + crc(pdu)


def parse_link_layer(packet: bytes, *, crc_checked: bool = False) -> list[Framed]:
    """The frames in a packet from access address to CRC; empty for other packets. Raises `FramingError`.

    A CRC of zero is one that the sniffer did not record. ``crc_checked``: the sniffer says that it was right.
    """
    if len(packet) < _HEADER_BYTES + _CRC_BYTES or int.from_bytes(packet[:4], "little") != _ACCESS_ADDRESS:
        return []
    kind, length = packet[4] & 15, packet[5]
    end = _HEADER_BYTES + length
    if kind not in _LEGACY and kind != _ADV_EXT_IND:
        return []
    if len(packet) < end + _CRC_BYTES:
        raise FramingError(f"a packet of {len(packet)} bytes announces {length} bytes of payload")
    payload = packet[_HEADER_BYTES:end]
    address, data = _legacy(payload) if kind in _LEGACY else _extended(payload)
    found = parse_advertising_data(data)
    check = packet[end : end + _CRC_BYTES]
    if found and not crc_checked and any(check) and check != crc(packet[4:end]):
        raise FramingError("the packet's CRC is wrong: it was not heard well")
    transport = "ble5" if kind == _ADV_EXT_IND else "ble4"
    return [Framed(framed.frame, transport, framed.counter, address) for framed in found]


def _legacy(payload: bytes) -> tuple[str | None, bytes]:
    if len(payload) < 6:
        raise FramingError(f"an advertisement of {len(payload)} bytes has no address")
    return format_address(payload[5::-1]), payload[6:]


def _extended(payload: bytes) -> tuple[str | None, bytes]:
    """Address and data of an extended advertising PDU (Bluetooth Core 5.4, volume 6, part B, 2.3.4)."""
    if not payload:
        raise FramingError("an extended advertisement without a header")
    length = payload[0] & 0x3F
    if 1 + length > len(payload):
        raise FramingError(f"an extended header of {length} bytes, of which {len(payload) - 1} are there")
    address = None
    if length:
        flags, at = payload[1], 2
        for flag, size in _EXTENDED_FIELDS:
            if flags & flag:
                if at + size > 1 + length:
                    raise FramingError("the extended header is shorter than the fields that it announces")
                if flag == 0x01:
                    address = format_address(payload[at : at + 6][::-1])
                at += size
    return address, payload[1 + length :]


def _crc_of(octet: int) -> int:
    for _ in range(8):
        octet = octet >> 1 ^ _CRC_POLYNOMIAL if octet & 1 else octet >> 1
    return octet


_CRC_TABLE: Final = tuple(_crc_of(octet) for octet in range(256))


def crc(pdu: bytes) -> bytes:
    """The CRC of an advertising channel's PDU, as transmitted (Bluetooth Core 5.4, volume 6, part B, 3.1.1)."""
    register = _CRC_INIT
    for octet in pdu:
        register = register >> 8 ^ _CRC_TABLE[(register ^ octet) & 0xFF]
    return register.to_bytes(3, "little")


# --- the host controller -------------------------------------------------------------------------------------------


class HciEvents:
    """Advertising reports among the packets of a host controller (H4); puts fragments together. Bounded in memory."""

    def __init__(self) -> None:
        self._pending: OrderedDict[tuple[bytes, int], bytes] = OrderedDict()

    def feed(self, packet: bytes) -> list[Framed]:
        """The frames that a packet completes; empty for all other packets. Raises `FramingError`."""
        if len(packet) < 5 or packet[0] != 0x04 or packet[1] != 0x3E or packet[3] not in {0x02, 0x0D}:
            return []
        if len(packet) < 3 + packet[2]:
            raise FramingError(f"an event of {packet[2]} bytes, of which {len(packet) - 3} are there")
        reports = _Reader(packet[: 3 + packet[2]], 5)
        found: list[Framed] = []
        for _ in range(packet[4]):
            found += self._legacy_report(reports) if packet[3] == 0x02 else self._extended_report(reports)
        return found

    @staticmethod
    def _legacy_report(reports: _Reader) -> list[Framed]:
        head = reports.take_bytes(9)
        data = reports.take_bytes(head[8])
        rssi_dbm = _rssi(reports.take_bytes(1)[0])
        address = format_address(head[7:1:-1])
        return [Framed(one.frame, "ble4", one.counter, address, rssi_dbm) for one in parse_advertising_data(data)]

    def _extended_report(self, reports: _Reader) -> list[Framed]:
        head = reports.take_bytes(24)
        data = reports.take_bytes(head[23])
        kind = int.from_bytes(head[:2], "little")
        key = bytes(head[3:9]), head[11]
        whole = self._pending.pop(key, b"") + data
        if kind >> 5 & 3 == 1:  # incomplete, more is to come
            if len(whole) <= MAX_ADVERTISING_BYTES:
                self._pending[key] = whole
                if len(self._pending) > _MAX_PENDING:
                    self._pending.popitem(last=False)
            return []
        transport = "ble4" if kind & 0x10 else "ble5"
        address, rssi_dbm = format_address(head[8:2:-1]), _rssi(head[13])
        return [Framed(one.frame, transport, one.counter, address, rssi_dbm) for one in parse_advertising_data(whole)]


class _Reader:
    def __init__(self, data: bytes, at: int) -> None:
        self._data = data
        self._at = at

    def take_bytes(self, size: int) -> bytes:
        taken = self._data[self._at : self._at + size]
        if len(taken) < size:
            raise FramingError("an advertising report that is cut off")
        self._at += size
        return taken


def _rssi(octet: int) -> int | None:
    """Signal strength, dBm; 127 says that there is none."""
    value = octet - 256 if octet > 127 else octet
    return value if -128 <= value <= 20 else None
