"""Wi-Fi: Remote ID in NAN service discovery frames and in a vendor element of beacons (ASTM F3411-22a, 5.4.7, 5.4.8).

IEEE 802.11 management frames from monitor mode, with or without a radiotap header. Both carry a message counter and
then a pack: NAN in the service info of the service ``org.opendroneid.remoteid``, beacons (and probe responses) in an
element of the OUI FA-0B-BC, type 0x0D.
"""

from __future__ import annotations

import struct
from typing import Final

from wonderland_remote_id.decoding import MAX_FRAME_BYTES
from wonderland_remote_id.errors import FramingError
from wonderland_remote_id.framings.framed import Framed, format_address, parse_address
from wonderland_remote_id.messages import MESSAGE_BYTES

SERVICE_ID: Final = bytes.fromhex("8869199d9209")
"""The first six bytes of SHA-256 of ``org.opendroneid.remoteid``."""
CHANNEL: Final = 6
MAX_PACKET_BYTES: Final = 4096

_VENDOR: Final = bytes.fromhex("fa0bbc0d")
_NAN: Final = bytes.fromhex("0409506f9a13")  # public action, vendor specific, Wi-Fi Alliance, NAN
_NAN_NETWORK: Final = bytes.fromhex("516f9a010000")
_NAN_CLUSTER: Final = bytes.fromhex("506f9a0100ff")
_BROADCAST: Final = b"\xff" * 6
_MAC_BYTES: Final = 24
_FIXED_BEACON_BYTES: Final = 12
_BEACON, _PROBE_RESPONSE, _ACTION, _ACTION_NO_ACK = 8, 5, 13, 14
_FCS_AT_END: Final = 0x10
_BAD_FCS: Final = 0x40


def beacon(frame: bytes, counter: int, address: str, ssid: str = "", sequence: int = 0) -> bytes:
    """A beacon (without FCS) that carries a frame. Raises `FramingError`."""
    body = _VENDOR + bytes((counter & 0xFF,)) + _checked(frame)
    name = ssid.encode()[:32]
    elements = bytes((0, len(name))) + name + bytes((1, 1, 0x8C, 0xDD, len(body))) + body
    fixed = bytes(8) + struct.pack("<HH", 200, 0x0020)
    source = _address(address)
    return _header(0x80, _BROADCAST, source, source, sequence) + fixed + elements


def nan_action(frame: bytes, counter: int, address: str, sequence: int = 0) -> bytes:
    """A NAN service discovery frame (without FCS) that carries a frame. Raises `FramingError`."""
    info = bytes((counter & 0xFF,)) + _checked(frame)
    descriptor = SERVICE_ID + bytes((1, 0, 0x10, len(info))) + info
    extension = bytes((1,)) + struct.pack("<H", 0x0200) + bytes((counter & 0xFF,))
    attributes = b"".join(
        struct.pack("<BH", kind, len(body)) + body for kind, body in ((0x03, descriptor), (0x0E, extension))
    )
    return _header(0xD0, _NAN_NETWORK, _address(address), _NAN_CLUSTER, sequence) + _NAN + attributes


def radiotap(packet: bytes, rssi_dbm: int) -> bytes:
    """A packet under a radiotap header that tells its signal strength."""
    return struct.pack("<BBHIBb", 0, 0, 10, 0x22, 0, rssi_dbm) + packet


def parse_radiotap(packet: bytes) -> list[Framed]:
    """The frames in a packet with a radiotap header; empty for other packets. Raises `FramingError`."""
    if len(packet) < 8:
        raise FramingError(f"{len(packet)} bytes are no radiotap header")
    length = int.from_bytes(packet[2:4], "little")
    if packet[0] != 0 or not 8 <= length <= len(packet):
        raise FramingError(f"a radiotap header of version {packet[0]} and {length} bytes, of {len(packet)}")
    flags, rssi_dbm = _radio_facts(packet[:length])
    inner = packet[length:]
    if flags & _FCS_AT_END:
        inner = inner[:-4]
    found = parse_packet(inner)
    if found and flags & _BAD_FCS:
        raise FramingError("the packet's FCS is wrong: it was not heard well")
    return [Framed(one.frame, one.transport, one.counter, one.address, rssi_dbm) for one in found]


def _radio_facts(header: bytes) -> tuple[int, int | None]:
    """Flags and signal strength: the fields before and including the sixth, each aligned to its size."""
    present, at = int.from_bytes(header[4:8], "little"), 8
    word = present
    while word & 0x80000000:
        word = int.from_bytes(header[at : at + 4], "little")
        at += 4
        if at > len(header):
            raise FramingError("a radiotap header whose presence words do not end")
    flags, rssi_dbm = 0, None
    for bit, (size, align) in enumerate(((8, 8), (1, 1), (1, 1), (4, 2), (2, 1), (1, 1))):
        if not present >> bit & 1:
            continue
        at = -(-at // align) * align
        value = header[at : at + size]
        if len(value) < size:
            raise FramingError("a radiotap header that is shorter than the fields that it announces")
        if bit == 1:
            flags = value[0]
        elif bit == 5:
            rssi_dbm = value[0] - 256 if value[0] > 127 else value[0]
        at += size
    return flags, rssi_dbm if rssi_dbm is not None and rssi_dbm <= 20 else None


def parse_packet(packet: bytes) -> list[Framed]:
    """The frames in an IEEE 802.11 packet; empty for all that is no Remote ID. Raises `FramingError`."""
    if len(packet) > MAX_PACKET_BYTES:
        raise FramingError(f"a packet of {len(packet)} bytes; Remote ID needs less than {MAX_PACKET_BYTES}")
    if len(packet) < _MAC_BYTES or packet[0] & 0x0F:  # version 0 and management only
        return []
    kind, address = packet[0] >> 4, format_address(packet[10:16])
    start = _MAC_BYTES + (4 if packet[1] & 0x80 else 0)  # the HT control field
    if kind in {_BEACON, _PROBE_RESPONSE}:
        bodies = _vendor_elements(packet[start + _FIXED_BEACON_BYTES :])
        transport = "wifi-beacon"
    elif kind in {_ACTION, _ACTION_NO_ACK} and packet[start : start + len(_NAN)] == _NAN:
        bodies = _service_infos(packet[start + len(_NAN) :])
        transport = "wifi-nan"
    else:
        return []
    found = []
    for body in bodies:
        if len(body) < 1 + MESSAGE_BYTES:
            raise FramingError(f"{len(body)} bytes of Remote ID; counter and message have {1 + MESSAGE_BYTES}")
        found.append(Framed(body[1:], transport, counter=body[0], address=address))
    return found


def _vendor_elements(elements: bytes) -> list[bytes]:
    found, at = [], 0
    while at + 2 <= len(elements):
        kind, length = elements[at], elements[at + 1]
        body = elements[at + 2 : at + 2 + length]
        ours = kind == 0xDD and body.startswith(_VENDOR)
        if len(body) < length:
            # Other elements that are cut off, or an FCS that looks like one, do not concern us.
            if ours:
                raise FramingError(f"an element of {length} bytes, of which {len(body)} are there")
            break
        if ours:
            found.append(body[len(_VENDOR) :])
        at += 2 + length
    return found


def _service_infos(attributes: bytes) -> list[bytes]:
    found, at = [], 0
    while at + 3 <= len(attributes):
        kind, length = attributes[at], int.from_bytes(attributes[at + 1 : at + 3], "little")
        body = attributes[at + 3 : at + 3 + length]
        ours = kind == 0x03 and body.startswith(SERVICE_ID)
        if ours and (len(body) < length or length < 10):
            raise FramingError(f"a service descriptor of {length} bytes, of which {len(body)} are there")
        if len(body) < length:
            break
        if ours:
            found.append(_service_info(body))
        at += 3 + length
    return found


def _service_info(descriptor: bytes) -> bytes:
    """The service info of a descriptor: after the control byte come optional fields that it announces."""
    control, at = descriptor[8], 9
    if control & 0x40:  # binding bitmap
        at += 2
    for flag in (0x04, 0x08):  # matching filter, service response filter
        if control & flag:
            at += 1 + (descriptor[at] if at < len(descriptor) else 0)
    if not control & 0x10 or at >= len(descriptor):
        raise FramingError("a service descriptor without service info")
    info = descriptor[at + 1 : at + 1 + descriptor[at]]
    if len(info) < descriptor[at]:
        raise FramingError(f"service info of {descriptor[at]} bytes, of which {len(info)} are there")
    return info


def _header(frame_control: int, destination: bytes, source: bytes, bssid: bytes, sequence: int) -> bytes:
    return (
        struct.pack("<HH", frame_control, 0) + destination + source + bssid + struct.pack("<H", (sequence & 4095) << 4)
    )


def _address(text: str) -> bytes:
    try:
        return parse_address(text)
    except ValueError:
        raise FramingError(f"{text!r:.40} is no address, for example 02:00:00:00:00:01") from None


def _checked(frame: bytes) -> bytes:
    if len(frame) > MAX_FRAME_BYTES:
        raise FramingError(f"a frame of {len(frame)} bytes; one has at most {MAX_FRAME_BYTES}")
    return frame
