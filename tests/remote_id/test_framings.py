"""Every framing both ways, the reference implementation's own bytes, and whatever else may come in instead."""

from __future__ import annotations

import base64
import contextlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_remote_id import (
    BasicId,
    FramingError,
    Location,
    OperatorLocationType,
    Pack,
    RemoteIdError,
    System,
    decode,
    encode,
)
from wonderland_remote_id.framings import ble, captures, json_feed, mavlink, wifi
from wonderland_remote_id.framings.framed import Framed
from wonderland_remote_id.json_form import from_json, to_json

ADDRESS = "c0:ff:ee:00:00:01"
SERIAL = encode(BasicId(uas_id="1581F5FKD229400A1234"))
PLACE = encode(Location(lat_e7=604_518_000, lon_e7=222_666_000))
PACK = encode(Pack(messages=(decode(SERIAL), decode(PLACE))))
RECORDED = json.loads((Path(__file__).parent / "recorded" / "reference_implementation.json").read_text())


@pytest.mark.parametrize("name", ["basic", "location", "auth0", "auth1", "selfid", "system", "operator"])
def test_the_reference_implementation_writes_the_same_bytes(name) -> None:
    frame = bytes.fromhex(RECORDED[name])
    assert encode(decode(frame)) == frame


def test_the_reference_implementations_wifi_frames() -> None:
    [nan] = wifi.parse_packet(bytes.fromhex(RECORDED["nan"]))
    [beacon] = wifi.parse_packet(bytes.fromhex(RECORDED["beacon"]))
    assert (nan.counter, beacon.counter, nan.address) == (42, 43, "02:00:00:00:00:01")
    assert nan.frame == beacon.frame
    assert wifi.nan_action(nan.frame, 42, nan.address).hex() == RECORDED["nan"]
    assert len(decode(nan.frame).messages) == 7


def test_the_reference_implementations_structure() -> None:
    data = {
        "MAC address": ADDRESS,
        "RSSI": -61,
        "UASdata": base64.b64encode(bytes.fromhex(RECORDED["struct"])).decode(),
    }
    [framed] = json_feed.parse_documents(json.dumps({"protocol": 1.0, "data": data}))
    assert (framed.address, framed.rssi_dbm) == (ADDRESS, -61)
    [nan] = wifi.parse_packet(bytes.fromhex(RECORDED["nan"]))
    assert set(decode(framed.frame).messages) == set(decode(nan.frame).messages)


@pytest.mark.parametrize("frame", [SERIAL, PLACE, PACK])
def test_every_framing_gives_back_what_went_in(frame) -> None:
    for extended in (False, True):
        if extended or len(frame) == 25:
            packet = ble.link_layer_packet(frame, 7, ADDRESS, extended=extended)
            assert ble.parse_link_layer(packet) == [Framed(frame, "ble5" if extended else "ble4", 7, ADDRESS)]
    [framed] = ble.parse_advertising_data(b"\x02\x01\x06" + ble.advertising_data(frame, 255))
    assert (framed.frame, framed.counter) == (frame, 255)
    assert wifi.parse_packet(wifi.beacon(frame, 8, ADDRESS, "drone")) == [Framed(frame, "wifi-beacon", 8, ADDRESS)]
    packet = wifi.radiotap(wifi.nan_action(frame, 9, ADDRESS), -71)
    assert wifi.parse_radiotap(packet) == [Framed(frame, "wifi-nan", 9, ADDRESS, -71)]
    [framed] = mavlink.parse_datagram(mavlink.build_frame(frame, address=ADDRESS))
    assert framed == Framed(frame, "mavlink", address=ADDRESS)


def test_a_packet_heard_badly() -> None:
    packet = bytearray(ble.link_layer_packet(SERIAL, 7, ADDRESS))
    packet[30] ^= 1
    with pytest.raises(FramingError, match="CRC"):
        ble.parse_link_layer(bytes(packet))
    assert len(ble.parse_link_layer(bytes(packet), crc_checked=True)) == 1
    assert len(ble.parse_link_layer(bytes(packet[:-3]) + bytes(3))) == 1
    tapped = bytearray(wifi.radiotap(wifi.beacon(SERIAL, 1, ADDRESS), -50))
    tapped[8] = 0x40
    with pytest.raises(FramingError, match="FCS"):
        wifi.parse_radiotap(bytes(tapped))
    tapped[8] = 0x10
    assert wifi.parse_radiotap(bytes(tapped) + b"\1\2\3\4")[0].frame == SERIAL


def test_what_is_no_remote_id_gives_nothing() -> None:
    assert ble.parse_advertising_data(b"\x02\x01\x06\x03\x03\xaa\xfe") == []
    assert ble.parse_advertising_data(b"\x05\x16\xfa\xff\x01\x02") == []  # the same UUID, another application
    assert ble.parse_link_layer(bytes(40)) == []
    assert wifi.parse_packet(b"\x08" + bytes(60)) == []
    assert wifi.parse_packet(b"\x80" + bytes(60)) == []
    assert ble.HciEvents().feed(b"\x04\x0e\x04\x01\x03\x0c\x00") == []
    assert json_feed.parse_documents('{"sn": "S", "gnss_satellites": 7}') == []


@pytest.mark.parametrize(
    "data",
    [b"\x1e\x16\xfa\xff\x0d\x01\x02", b"\x06\x16\xfa\xff\x0d\x01\x02", b"\x04\x16\xfa\xff\x0d"],
)
def test_remote_id_that_is_cut_off_is_an_error(data) -> None:
    with pytest.raises(FramingError):
        ble.parse_advertising_data(data)


def hci_extended(data: bytes, *, incomplete: bool = False) -> bytes:
    kind = (0x20 if incomplete else 0).to_bytes(2, "little")
    report = kind + b"\1" + bytes.fromhex("010000eeffc0") + bytes((1, 3, 0, 127, 0xC4, 0, 0, 0)) + bytes(6)
    body = bytes((0x0D, 1)) + report + bytes((len(data),)) + data
    return bytes((4, 0x3E, len(body))) + body


def test_host_controller_events() -> None:
    events = ble.HciEvents()
    data = ble.advertising_data(SERIAL, 3)
    legacy = bytes((0x02, 1, 3, 1)) + bytes.fromhex("010000eeffc0") + bytes((len(data),)) + data + bytes((0xB0,))
    [framed] = events.feed(bytes((4, 0x3E, len(legacy))) + legacy)
    assert framed == Framed(SERIAL, "ble4", 3, ADDRESS, -80)
    whole = ble.advertising_data(PACK, 4)
    assert events.feed(hci_extended(whole[:20], incomplete=True)) == []
    assert events.feed(hci_extended(whole[20:])) == [Framed(PACK, "ble5", 4, ADDRESS, -60)]
    with pytest.raises(FramingError):
        events.feed(bytes((4, 0x3E, 4, 0x02, 1, 3, 1)))


def test_mavlink_is_what_pymavlink_speaks() -> None:
    dialect = pytest.importorskip("pymavlink.dialects.v20.common")
    peer = dialect.MAVLink(None, srcSystem=1, srcComponent=236)
    for name in ("basic", "location", "auth0", "auth1", "selfid", "system", "operator"):
        frame = bytes.fromhex(RECORDED[name])
        [message] = peer.parse_buffer(mavlink.build_frame(frame, address=ADDRESS))
        assert message.get_type().startswith("OPEN_DRONE_ID_")
        if name == "location":
            assert (message.latitude, message.direction, message.speed_vertical) == (604_518_000, 21_500, -150)
        [framed] = mavlink.parse_datagram(bytes(message.pack(peer)))
        assert framed == Framed(frame, "mavlink", address=ADDRESS)
    heartbeat = bytes(peer.heartbeat_encode(2, 3, 0, 0, 4).pack(peer))
    stream = mavlink.MavlinkStream()
    noisy = heartbeat + b"\xfd\x00garbage" + mavlink.build_frame(PACK) + heartbeat[:5]
    found = [one for octet in noisy for one in stream.feed(bytes((octet,)))]
    assert found == [Framed(PACK, "mavlink")]


def test_mavlink_moves_the_operator() -> None:
    """SYSTEM_UPDATE has no address and nothing but a place: it belongs to the System message before it."""
    system = System(operator_lat_e7=1, operator_lon_e7=2, area_count=3, operator_location=OperatorLocationType.TAKEOFF)
    dialect = pytest.importorskip("pymavlink.dialects.v20.common")
    speaker = dialect.MAVLink(None, srcSystem=1, srcComponent=236)

    def spoken(lat_e7: int, lon_e7: int) -> bytes:
        return speaker.open_drone_id_system_update_encode(0, 0, lat_e7, lon_e7, 31.5, 5).pack(speaker)

    arm = speaker.open_drone_id_arm_status_encode(1, b"no GNSS").pack(speaker)
    stream = mavlink.MavlinkStream()
    assert list(stream.feed(arm)) == []
    (alone,) = stream.feed(spoken(601_700_000, 249_400_000))
    assert decode(alone.frame).operator_location is OperatorLocationType.LIVE_GNSS
    (before,) = stream.feed(mavlink.build(system, address=ADDRESS))
    (after,) = stream.feed(spoken(601_700_000, 249_400_000))
    moved = replace(
        system, operator_lat_e7=601_700_000, operator_lon_e7=249_400_000, operator_altitude_mm=31_500,
        t_ms=1_546_300_805_000,
    )  # fmt: skip
    assert (decode(after.frame), after.address) == (moved, before.address)
    list(stream.feed(mavlink.build(system, address="02:00:00:00:00:77")))
    assert list(stream.feed(spoken(1, 1))) == [], "a relay of several drones: whose operator moved, nobody knows"
    assert stream.skipped_bytes == 0


def test_mavlink_with_impossible_contents_is_an_error_and_the_next_packet_is_read() -> None:
    bad = bytearray(mavlink.build_frame(PLACE))
    bad[10 + 3] = 0x7F  # a latitude of 213°
    content = bytes(bad[1:-2])
    bad[-2:] = mavlink.checksum(content + bytes((254,))).to_bytes(2, "little")
    error, framed = mavlink.parse_datagram(bytes(bad) + mavlink.build_frame(SERIAL))
    assert isinstance(error, RemoteIdError)
    assert "latitude" in str(error)
    assert framed.frame == SERIAL
    bad[-1] ^= 1  # and with a wrong checksum there is nothing there at all
    assert len(mavlink.parse_datagram(bytes(bad) + mavlink.build_frame(SERIAL))) == 1


def test_dragonsync_and_dronetag() -> None:
    dragonsync = [
        {"Basic ID": {"id_type": "Serial Number (ANSI/CTA-2063-A)", "id": "1581F5FKD229400A1234", "ua_type": 2,
                      "MAC": "AA:BB:CC:DD:EE:FF", "RSSI": -65}},
        {"Location/Vector Message": {"latitude": 60.4518, "longitude": 22.2666, "geodetic_altitude": "40.0 m",
                                     "height_agl": 12.5, "speed": 5.5, "vert_speed": -1.5, "direction": 215,
                                     "op_status": "Airborne", "horizontal_accuracy": "<3 m", "timestamp": "1234.5"}},
        {"System Message": {"latitude": 60.452, "longitude": 22.267}},
        {"Self-ID Message": {"text": "survey"}},
    ]  # fmt: skip
    [framed] = json_feed.parse_documents(json.dumps(dragonsync))
    identity, place, system, text = decode(framed.frame).messages
    assert (framed.address, framed.rssi_dbm, identity.uas_id) == ("aa:bb:cc:dd:ee:ff", -65, "1581F5FKD229400A1234")
    assert (place.lat_e7, place.altitude_mm, place.status.name, place.after_hour_ms) == (
        604_518_000,
        40_000,
        "AIRBORNE",
        1_234_500,
    )
    assert place.horizontal_accuracy.mm == 3_000
    assert (system.operator_lat_e7, text.text) == (604_520_000, "survey")
    dronetag = {
        "sn": "SCOUT1", "rssi": -70, "tech": "BT4",
        "odid": {"BasicID": [{"UASID": "1581F5FKD229400A1234", "IDType": 1, "UAType": 2}],
                 "Location": {"Latitude": 60.4518, "Longitude": 22.2666, "AltitudeGeo": 40, "Direction": 215,
                              "Timestamp": "2026-01-15T10:20:34.500Z", "Status": 2},
                 "System": {"OperatorLatitude": 60.452, "OperatorLongitude": 22.267},
                 "OperatorID": {"OperatorId": "FIN87astrdge12k8"}},
    }  # fmt: skip
    batch = json.dumps(dronetag) + "\r\n" + json.dumps([dronetag, dronetag])
    found = json_feed.parse_documents(batch)
    assert len(found) == 3
    place = decode(found[0].frame).messages[1]
    assert (place.track_cdeg, place.after_hour_ms) == (21_500, 1_234_500)


@pytest.mark.parametrize(
    "text",
    [
        "", "nonsense", "3", '{"messages": 3}', '{"messages": [{"type": "basic_id"}]}', '{"type": "nothing"}',
        "[1, 2]", '{"data": {"UASdata": "!"}}', '{"data": {"UASdata": "AAAA"}}', "[" * 5000, "\x00", '{"a": 1e999}',
        '{"odid": {"Location": {"Latitude": 91, "Longitude": 0}}}', '{"messages": [{"type": "self_id", "text": 3}]}',
        '{"Basic ID": {"id": "123456789012345678901"}}', '{"messages": [{"type": "location", "lat_e7": true}]}',
        '{"type": "pack", "messages": [{"type": "pack", "messages": []}]}', "1 " * 400, "x" * 70_000,
    ],
)  # fmt: skip
def test_json_that_is_no_remote_id(text) -> None:
    with contextlib.suppress(RemoteIdError):
        assert json_feed.parse_documents(text) == []


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_json_is_without_loss(messages_and_packs, data) -> None:
    message = data.draw(messages_and_packs)
    back = from_json(json.loads(json.dumps(to_json(message))))
    if "operator_id" not in json.dumps(to_json(message)):  # its secret is cut off
        assert back == message


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_mavlink_is_without_loss(messages_and_packs, data) -> None:
    message = data.draw(messages_and_packs)
    [framed] = mavlink.parse_datagram(mavlink.build(message))
    back = decode(framed.frame)
    if isinstance(message, Pack):
        assert back.messages == message.messages
    else:  # MAVLink has no protocol version
        assert encode(back)[1:] == encode(message)[1:]


def pcap(*records: tuple[bytes, int], link_type: int) -> bytes:
    return captures.pcap_header(link_type) + b"".join(captures.pcap_record(data, t_ms) for data, t_ms in records)


def read(data: bytes, size: int = 1 << 16) -> list[tuple[int, object]]:
    reader, unwrapper, found = captures.CaptureReader(), captures.Unwrapper(), []
    for at in range(0, len(data), size):
        for packet in reader.feed(data[at : at + size]):
            try:
                found += [(packet.number, framed) for framed in unwrapper.frames(packet)]
            except FramingError as error:
                found.append((packet.number, error))
    reader.finish()
    return found


def pcapng(packets: list[bytes], link_type: int, order: str = "little") -> bytes:
    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        length = (12 + len(body)).to_bytes(4, order)
        return kind.to_bytes(4, order) + length + body + length

    nanoseconds = (9).to_bytes(2, order) + (1).to_bytes(2, order) + b"\x09\0\0\0"
    out = block(0x0A0D0D0A, (0x1A2B3C4D).to_bytes(4, order) + (1).to_bytes(2, order) + bytes(2) + b"\xff" * 8)
    out += block(1, link_type.to_bytes(2, order) + bytes(6) + nanoseconds)
    out += block(5, bytes(12))  # interface statistics: passed over
    for number, packet in enumerate(packets):
        t_ns = 1_800_000_000_000_000_000 + number * 1_000_000_000
        size = len(packet).to_bytes(4, order)
        head = bytes(4) + (t_ns >> 32).to_bytes(4, order) + (t_ns & 0xFFFFFFFF).to_bytes(4, order)
        out += block(6, head + size + size + packet)
    return out


@pytest.mark.parametrize("size", [1, 7, 1 << 16])
def test_captures(size) -> None:
    beacon, nan = wifi.beacon(PACK, 1, ADDRESS), wifi.nan_action(PACK, 2, ADDRESS)
    found = read(pcap((beacon, 1_800_000_000_123), (bytes(30), 0), (nan, 1_800_000_001_000), link_type=105), size)
    assert [(number, framed.t_ms) for number, framed in found] == [(1, 1_800_000_000_123), (3, 1_800_000_001_000)]
    for order in ("little", "big"):
        found = read(pcapng([wifi.radiotap(beacon, -50), wifi.radiotap(nan, -51)], 127, order), size)
        assert [(framed.rssi_dbm, framed.t_ms) for _, framed in found] == [
            (-50, 1_800_000_000_000),
            (-51, 1_800_000_001_000),
        ]
    packet = ble.link_layer_packet(SERIAL, 5, ADDRESS)
    sniffed = bytes((37, 0xC8, 0, 0)) + packet[:4] + (0x0C03).to_bytes(2, "little") + packet
    coded = bytes((37, 0xC8, 0, 0)) + packet[:4] + (0x8C03).to_bytes(2, "little") + packet[:4] + b"\1" + packet[4:]
    found = read(pcap((sniffed, 0), (coded, 1), (sniffed[:30], 2), link_type=256), size)
    assert [framed.frame for _, framed in found[:2]] == [SERIAL, SERIAL]
    assert found[0][1].rssi_dbm == -56
    assert isinstance(found[2][1], FramingError)


def btsnoop(kind: int, *records: tuple[int, bytes]) -> bytes:
    t_us = 0x00DCDDB30F2F8000 + 1_800_000_000_000_000
    out = b"btsnoop\0" + (1).to_bytes(4, "big") + kind.to_bytes(4, "big")
    for flags, data in records:
        size = len(data).to_bytes(4, "big")
        out += size + size + flags.to_bytes(4, "big") + bytes(4) + t_us.to_bytes(8, "big") + data
    return out


@pytest.mark.parametrize("size", [1, 5, 1 << 16])
def test_what_btmon_writes(size) -> None:
    """`btmon -w`: adapter and opcode in the flags (3: an event), the packet without its type; Android: H4."""
    event = hci_extended(ble.advertising_data(PACK, 1))
    monitor = btsnoop(2001, (0, b"new index"), (3, event[1:]), (2, event[1:]), (1 << 16 | 3, event[1:]))
    found = read(monitor, size)
    assert [(number, framed.frame, framed.t_ms) for number, framed in found] == [
        (2, PACK, 1_800_000_000_000), (4, PACK, 1_800_000_000_000),
    ]  # fmt: skip
    assert [framed.frame for _, framed in read(btsnoop(1002, (3, event), (0, b"\x01cmd")), size)] == [PACK]
    assert [framed.frame for _, framed in read(btsnoop(1001, (3, event[1:]), (2, event[1:])), size)] == [PACK]
    assert [framed.frame for _, framed in read(pcap((b"\0\0\0\3" + event[1:], 0), link_type=254), size)] == [PACK]


def test_headers_of_other_sniffers() -> None:
    packet, beacon = ble.link_layer_packet(SERIAL, 5, ADDRESS), wifi.beacon(PACK, 1, ADDRESS)
    head = bytes((0, 6, 10 + len(packet), 1, 0, 0, 6, 10))
    nordic = head + bytes((1, 37, 61, 0, 0)) + bytes(4) + packet
    (_, heard), (_, bad) = read(pcap((nordic, 0), (nordic[:8] + b"\0" + nordic[9:], 1), (head, 2), link_type=272))
    assert (heard.frame, heard.rssi_dbm) == (SERIAL, -61)
    assert "CRC" in bad.message
    ppi = bytes((0, 0, 12, 0)) + (105).to_bytes(4, "little") + bytes(4)
    (_, heard), (_, bad) = read(pcap((ppi + beacon, 0), (ppi[:7], 1), link_type=192))
    assert heard.frame == PACK
    assert "PPI" in bad.message


def test_an_interface_that_holds_no_remote_id_is_passed_over() -> None:
    """What the audit found: a second interface of another type ended the reading, as `-i any` captures have it."""
    beacon = wifi.beacon(PACK, 1, ADDRESS)
    wired = pcapng([bytes(60), bytes(60)], 1)
    found = read(wired + pcapng([beacon], 105) + wired)
    assert [number for number, _ in found] == [1, 3, 4]
    assert found[1][1].frame == PACK
    for _, error in (found[0], found[2]):
        assert "link type 1 holds no Remote ID" in error.message
    head = pcapng([], 105)
    two = head + wired[28:56] + pcapng([beacon], 105)[len(head) :]
    assert [framed.frame for _, framed in read(two)] == [PACK]


@pytest.mark.parametrize(
    "data",
    [
        b"btsnoop\0" + bytes(8), btsnoop(2002), btsnoop(2001, (3, b"cut"))[:-1], b"", b"\x1f\x8b\x08\x00" + bytes(30), pcap(link_type=1), pcap((bytes(30), 0), link_type=105)[:-1],
        captures.pcap_header(105) + b"\xff" * 16, pcapng([bytes(10)], 105)[:-5], pcapng([], 105) + b"\1\0\0\0" * 4,
        pcapng([], 105) + bytes.fromhex("060000002000000005000000") + bytes(16) + bytes.fromhex("20000000"),
    ],
)  # fmt: skip
def test_files_that_are_no_captures(data) -> None:
    with pytest.raises(captures.CaptureError):
        read(data)


@settings(max_examples=400, deadline=None)
@given(data=st.binary(max_size=400), seed=st.sampled_from(range(9)), at=st.integers(0, 400), octet=st.integers(0, 255))
def test_garbage_ends_in_nothing_but_typed_errors(data, seed, at, octet) -> None:
    valid = (
        ble.advertising_data(PACK, 1), ble.link_layer_packet(PACK, 1, ADDRESS, extended=True),
        wifi.beacon(PACK, 1, ADDRESS), wifi.nan_action(PACK, 1, ADDRESS), mavlink.build_frame(PACK),
        btsnoop(2001, (3, hci_extended(ble.advertising_data(PACK, 1))[1:])), pcapng([wifi.beacon(PACK, 1, ADDRESS)], 105), hci_extended(ble.advertising_data(PACK, 1)),
        bytes.fromhex(RECORDED["struct"]),
    )[seed]  # fmt: skip
    mutated = bytearray(valid)
    mutated[at % len(valid)] = octet
    for piece in (data, bytes(mutated), bytes(mutated[: at % len(valid)])):
        for parse in (
            ble.parse_advertising_data, ble.parse_link_layer, wifi.parse_packet, wifi.parse_radiotap,
            mavlink.parse_datagram, ble.HciEvents().feed, json_feed.parse_documents, read,
            json_feed.parse_core_structure,
        ):  # fmt: skip
            with contextlib.suppress(RemoteIdError):
                parse(piece)
