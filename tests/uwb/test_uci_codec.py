"""UCI on the wire: bytes seen on real and independent stacks, and properties of every codec."""

from __future__ import annotations

import contextlib
import dataclasses

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.uwb.layout import RangingPlan
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.codec import DeviceCodec, HostCodec, MalformedMessage, UnknownMessage
from wonderland_fira_uci.uci.config import (
    AppConfig,
    DeviceRole,
    DeviceType,
    MultiNodeMode,
    ParameterId,
    StsConfig,
    TimeBase,
    UciParameterError,
    decode_parameters,
    encode_parameters,
)
from wonderland_fira_uci.uci.data import (
    DataCredit,
    DataReceive,
    DataSend,
    DataTransferStatus,
    decode_data_receive,
    decode_data_send,
    decode_data_transfer_status,
    encode_data_credit,
    encode_data_receive,
    encode_data_send,
    encode_data_transfer_status,
)
from wonderland_fira_uci.uci.errors import UciDecodeError, UciEncodeError, UciError
from wonderland_fira_uci.uci.packets import (
    MAX_DATA_PAYLOAD,
    DataFormat,
    MessageType,
    PacketReader,
    encode_control,
    encode_data,
)
from wonderland_fira_uci.uci.ranging import (
    MeasurementType,
    OneWayMeasurement,
    RangeData,
    TwoWayMeasurement,
    decode_range_data,
    encode_range_data,
)
from wonderland_fira_uci.uci.session import (
    Command,
    DeviceInfo,
    DeviceStatus,
    Response,
    SessionStatus,
    decode_config_refusal,
    decode_device_info,
    decode_init_response,
    deinit_command,
    device_info_command,
    encode_device_info,
    encode_device_status,
    encode_session_status,
    init_command,
    reset_command,
    set_app_config_command,
    start_command,
    stop_command,
)
from wonderland_fira_uci.uci.status import Status, status_name

KEY = bytes(range(16))
PAD_NODE = bytes.fromhex(
    "16 260100 000100 110100 030101 010102 220101 060201a0 050101 070201d0 040109 08026009 1b0119 0904c8000000 "
    "0c0103 120101 14010a 150102 2e0101 0d0100 130100 020103 4510"
)
RANGE_NTF = bytes.fromhex(
    "62000038 2a000000 01000000 00 00000000 01 00 00 0000000000000000 01"
    "01d0 00 00 f401 2500 64 0000 64 71ff 64 0000 64 00 ff 0000000000000000000000"
)
fast = settings(max_examples=100, deadline=None)


def app(**changes: object) -> AppConfig:
    values: dict[str, object] = {
        "device_type": DeviceType.CONTROLEE,
        "device_role": DeviceRole.RESPONDER,
        "multi_node_mode": MultiNodeMode.ONE_TO_MANY,
        "mac_address": 0xA001,
        "destination_macs": (0xD001,),
        "interval_ms": 200,
        "session_key": KEY,
    }
    return AppConfig(**(values | changes))  # type: ignore[arg-type]


def host(data: bytes) -> list[object]:
    codec = HostCodec()
    codec.receive_data(data)
    assert not codec.reader.desynchronised
    return list(codec.events())


def test_commands_have_the_bytes_that_nodes_accept() -> None:
    assert reset_command().encode().hex() == "2000000100"
    assert device_info_command().encode().hex() == "20020000"
    assert init_command(0x11223344, 1).encode().hex() == "210000054433221101"
    assert start_command(7).encode().hex() == "2200000407000000"
    assert stop_command(7).encode().hex() == "2201000407000000"
    assert deinit_command(7).encode().hex() == "2101000407000000"
    codec = HostCodec()
    codec.send_data(DataSend(7, 0xD001, 3, b"sixteen octets!!"))
    assert codec.data_to_send().hex() == "01002000" + "07000000" + "01d0000000000000" + "0300" + "1000" + (
        b"sixteen octets!!".hex()
    )


def test_the_configuration_of_a_pad_node_is_octet_for_octet_the_accepted_one() -> None:
    assert app().encode() == PAD_NODE + KEY
    command = set_app_config_command(7, app().parameters()).encode()
    assert command[:8].hex() == "2103" + f"00{4 + len(PAD_NODE) + 16:02x}" + "07000000"


def test_the_drones_configuration_and_session_b_differ_where_they_should() -> None:
    plan = RangingPlan(
        session_a_id=1,
        session_b_id=2,
        pad_macs=(0xA001, 0xA002, 0xA003, 0xA004),
        uav_mac=0xD001,
        sts_key=KEY,
        words="initiator",
    )
    pad, uav = plan.pad_ranging(0), plan.uav_ranging()
    assert (pad.session_id, pad.session_type) == (1, 1)
    drone, node = dict(uav.app.parameters()), dict(pad.app.parameters())
    assert {i: v.hex() for i, v in drone.items() if node[i] != v} == {
        0x00: "01",
        0x11: "01",
        0x06: "01d0",
        0x05: "04",
        0x07: "01a002a003a004a0",
    }
    pad_words, uav_words = plan.pad_words(), plan.uav_words()
    assert pad_words is not None
    assert uav_words is not None
    words, heard = dict(pad_words.app.parameters()), dict(uav_words.app.parameters())
    # Rounds of 12 and of 6 slots of 2 ms, and half a millisecond to spare; the second begins where the first ends.
    assert (words[0x03], words[0x09], drone[0x09]) == (b"\x00", b"\x25\0\0\0", b"\x25\0\0\0")
    assert pad_words.time_base == TimeBase(1, 24_000)
    assert (words[0x00], words[0x11], words[0x06], words[0x07]) == (b"\x01", b"\x01", b"\x01\xa0", b"\x01\xd0")
    assert (heard[0x00], heard[0x11], heard[0x06], heard[0x07]) == (b"\x00", b"\x00", b"\x01\xd0", b"\x01\xa0")
    assert words[0x45] == heard[0x45] == KEY
    assert pad_words.session_id == uav_words.session_id == 2
    both_ways = dataclasses.replace(plan, words="both_ways")
    assert both_ways.pad_words() is both_ways.uav_words() is None
    assert both_ways.interval_ms == 25


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"session_a_id": 0}, "session_a_id"),
        ({"session_b_id": 1}, "session_b_id"),
        ({"pad_macs": ()}, "pad_macs"),
        ({"pad_macs": (1, 1)}, "share"),
        ({"uav_mac": 0xFFFF}, "0xfffd"),
        ({"sts_key": b"short"}, "sts_key"),
        ({"channel": 7}, "channel"),
        ({"preamble_code": 8}, "preamble_code"),
        ({"slot_duration_rstu": 0x10000}, "slot_duration_rstu"),
        ({"slot_duration_rstu": 500}, "a frame with 84 octets of data and the turn after it take 498 µs; at least 598"),
    ],
)
def test_a_plan_that_cannot_run_is_refused_by_name(changes: dict[str, object], text: str) -> None:
    good: dict[str, object] = {
        "session_a_id": 1,
        "session_b_id": 2,
        "pad_macs": (1, 2, 3, 4),
        "uav_mac": 9,
        "sts_key": KEY,
    }
    with pytest.raises(RangingPlanError, match=text):
        RangingPlan(**(good | changes))  # type: ignore[arg-type]
    plan = RangingPlan(**good)  # type: ignore[arg-type]
    with pytest.raises(RangingPlanError, match="pad node 4"):
        plan.pad_ranging(4)
    assert repr(KEY) not in repr(plan)
    assert repr(KEY) not in repr(plan.uav_ranging())


def test_a_range_notification_of_a_pad_node() -> None:
    [report] = host(RANGE_NTF)
    assert isinstance(report, RangeData)
    assert (report.sequence, report.handle, report.measurement_type) == (42, 1, 1)
    [record] = report.two_way
    assert (record.mac_address, record.status, record.range_mm, record.obstructed) == (0xD001, 0, 5_000, False)
    assert (record.azimuth_q7, record.azimuth_fom, record.destination_azimuth_q7) == (0x25, 0x64, -143)
    assert record.rssi_dbm is None
    assert encode_control(MessageType.NOTIFICATION, 2, 0, encode_range_data(report)) == RANGE_NTF
    four = report._replace(two_way=(record,) * 4)
    assert encode_control(MessageType.NOTIFICATION, 2, 0, encode_range_data(four))[:4].hex() == "62000095"


def test_responses_and_notifications_seen_on_nodes() -> None:
    assert host(bytes.fromhex("6001000101")) == [DeviceStatus(1)]
    assert host(bytes.fromhex("4000000100 6001000101")) == [Response(0, 0, 0, b""), DeviceStatus(1)]
    assert host(bytes.fromhex("61020006 01000000 03 00")) == [SessionStatus(1, 3, 0)]
    assert host(bytes.fromhex("62040005 01000000 01")) == [DataCredit(1, 1)]
    assert host(bytes.fromhex("62050007 01000000 07 05 01")) == [DataTransferStatus(1, 7, 5, 1)]
    assert host(bytes.fromhex("62050008 01000000 0701 05 01")) == [DataTransferStatus(1, 0x0107, 5, 1)]
    assert host(bytes.fromhex("4400000107")) == [Response(4, 0, Status.UNKNOWN_GID, b"")]
    assert host(bytes.fromhex("6e0100020102")) == [UnknownMessage(14, 1, b"\x01\x02")]
    [refusal] = host(bytes.fromhex("41030004 04 01 08 04"))
    assert isinstance(refusal, Response)
    assert decode_config_refusal(refusal) == {0x08: 4}
    [malformed] = host(bytes.fromhex("410300020103"))
    assert isinstance(malformed, Response)
    assert decode_config_refusal(malformed) == {}
    [v1], [v2] = host(bytes.fromhex("4100000100")), host(bytes.fromhex("4100000500") + bytes.fromhex("09000000"))
    assert isinstance(v1, Response)
    assert isinstance(v2, Response)
    assert (decode_init_response(v1, 5), decode_init_response(v2, 5)) == (5, 9)
    [received] = host(bytes.fromhex("02002100 07000000 00 01d0000000000000 0100 1000") + b"sixteen octets!!")
    assert received == DataReceive(7, 0, 0xD001, 1, b"sixteen octets!!")
    info = DeviceInfo(2, 2, 2, 1, b"")
    [answer] = host(encode_device_info(info).encode())
    assert isinstance(answer, Response)
    assert answer.encode()[:4].hex() == "4002000a"
    assert decode_device_info(answer.body) == info


def test_long_messages_are_split_and_joined_even_with_notifications_amid() -> None:
    payload = bytes(range(256)) * 3
    packets = encode_control(MessageType.NOTIFICATION, 2, 0, payload)
    assert packets[:4].hex() == "720000ff"
    reader = PacketReader("host")
    reader.receive_data(packets[:259])
    assert reader.incomplete
    reader.receive_data(encode_device_status(1))
    reader.receive_data(packets[259:])
    assert reader.packets() == [(0x60, 1, b"\x01"), (0x62, 0, payload)]
    assert not reader.incomplete
    device = DeviceCodec()
    device.receive_data(Command(1, 3, payload).encode())
    assert device.events() == [Command(1, 3, payload)]


@fast
@given(
    st.lists(
        st.one_of(
            st.tuples(st.integers(0, 15), st.integers(0, 0x3F), st.binary(max_size=700)),
            st.binary(max_size=300),
        ),
        max_size=8,
    ),
    st.lists(st.integers(1, 400), max_size=20),
)
def test_packets_survive_any_cutting_of_the_stream(
    messages: list[tuple[int, int, bytes] | bytes], cuts: list[int]
) -> None:
    stream, wanted = b"", []
    for message in messages:
        if isinstance(message, bytes):
            stream += encode_data(DataFormat.RECEIVE, message)
            wanted.append((2, 0, message))
        else:
            stream += encode_control(MessageType.NOTIFICATION, *message)
            wanted.append((0x60 | message[0], message[1], message[2]))
    reader = PacketReader("host")
    got = []
    for cut in cuts:
        reader.receive_data(stream[:cut])
        stream = stream[cut:]
        got += reader.packets()
    reader.receive_data(stream)
    assert got + reader.packets() == wanted
    assert not reader.incomplete
    assert not reader.desynchronised


@settings(max_examples=300, deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=6), st.sampled_from(("host", "device")))
def test_garbage_never_raises_and_a_reset_mends_the_stream(chunks: list[bytes], side: str) -> None:
    codec = HostCodec() if side == "host" else DeviceCodec()
    for chunk in chunks:
        codec.receive_data(chunk)
        codec.events()
    codec.reader.reset()
    if isinstance(codec, HostCodec):
        codec.receive_data(RANGE_NTF)
        [event] = codec.events()
        assert isinstance(event, RangeData)
    else:
        codec.receive_data(reset_command().encode())
        assert codec.events() == [reset_command()]


def test_after_an_impossible_header_nothing_is_believed_until_the_reset() -> None:
    """Else a peer could put a packet into data that it sends, and have it read as this node's own word."""
    codec = HostCodec()
    codec.receive_data(b"\xff\x01" + b"\x00" * 4 + RANGE_NTF)
    codec.receive_data(RANGE_NTF)
    assert codec.events() == []
    assert codec.reader.desynchronised
    assert codec.reader.reset() == 6 + 2 * len(RANGE_NTF)
    codec.receive_data(RANGE_NTF)
    assert len(codec.events()) == 1


@pytest.mark.parametrize(
    "header",
    ["80000000", "a0000000", "20000000", "62400000", "62000100", "01000000", "02010000", "020000ff", "03000000"],
)
def test_headers_that_a_host_cannot_hear(header: str) -> None:
    reader = PacketReader("host")
    reader.receive_data(bytes.fromhex(header))
    assert reader.desynchronised
    assert reader.reset() == 4


def test_what_is_unfinished_is_bounded() -> None:
    reader = PacketReader("host")
    segment = bytes.fromhex("720000ff") + bytes(255)
    for _ in range(257):
        reader.receive_data(segment)
    assert not reader.desynchronised
    reader.receive_data(segment)
    assert reader.desynchronised
    assert not reader.incomplete
    reader.reset()
    for opcode in range(9):
        reader.receive_data(bytes((0x72, opcode, 0, 0)))
    assert reader.desynchronised


def test_limits_of_encoding() -> None:
    with pytest.raises(UciEncodeError, match="65536"):
        encode_control(MessageType.COMMAND, 0, 0, bytes(65_537))
    with pytest.raises(UciEncodeError, match="out of range"):
        encode_control(MessageType.COMMAND, 16, 0)
    with pytest.raises(UciEncodeError, match="data packet"):
        encode_data(DataFormat.SEND, bytes(MAX_DATA_PAYLOAD + 1))
    with pytest.raises(UciEncodeError, match="DATA_MESSAGE_SND"):
        encode_data_send(DataSend(-1, 0, 0, b""))
    with pytest.raises(UciEncodeError, match="RANGE_DATA_NTF"):
        encode_range_data(RangeData(0, 0, 0, 0, 1, 0, (TwoWayMeasurement(0, 0, 0, 70_000),)))
    with pytest.raises(UciEncodeError, match="255"):
        encode_range_data(RangeData(0, 0, 0, 0, 1, 0, (TwoWayMeasurement(0, 0, 0, 0),) * 256))


u8, u16, u32, u64 = (st.integers(0, 2**n - 1) for n in (8, 16, 32, 64))
i16 = st.integers(-(2**15), 2**15 - 1)


@st.composite
def reports(draw: st.DrawFn) -> RangeData:
    extended = draw(st.integers(0, 1))
    mac = u64 if extended else u16
    head = (draw(u32), draw(u32), draw(u8), draw(u32))
    if draw(st.booleans()):
        two = st.builds(TwoWayMeasurement, mac, u8, u8, u16, *([i16, u8] * 4), u8, u8)
        return RangeData(*head, MeasurementType.TWO_WAY, extended, tuple(draw(st.lists(two, max_size=6))))
    one = st.builds(
        OneWayMeasurement, mac, u8, u8, i16, u8, i16, u8, u64, u32, st.binary(max_size=20), st.binary(max_size=20)
    )
    return RangeData(*head, MeasurementType.ONE_WAY, extended, (), tuple(draw(st.lists(one, max_size=6))))


@fast
@given(reports())
def test_reports_round_trip(report: RangeData) -> None:
    payload = encode_range_data(report)
    assert decode_range_data(payload) == report
    if report.two_way:
        assert len(payload) == 25 + 31 * len(report.two_way)


@fast
@given(u32, u64, u16, u8, st.binary(max_size=200))
def test_data_messages_round_trip(handle: int, address: int, sequence: int, octet: int, data: bytes) -> None:
    send = DataSend(handle, address, sequence, data)
    assert decode_data_send(encode_data_send(send)) == send
    receive = DataReceive(handle, octet, address, sequence, data)
    assert decode_data_receive(encode_data_receive(receive)) == receive
    credit = encode_data_credit(DataCredit(handle, octet))
    assert host(encode_control(MessageType.NOTIFICATION, 2, 4, credit)) == [DataCredit(handle, octet)]
    transfer = DataTransferStatus(handle, sequence & 0xFF, octet, octet)
    assert decode_data_transfer_status(encode_data_transfer_status(transfer)) == transfer
    assert host(encode_session_status(SessionStatus(handle, octet, octet))) == [SessionStatus(handle, octet, octet)]


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 15), st.integers(0, 7), st.binary(max_size=120))
def test_damaged_payloads_are_reported_by_name_and_the_stream_goes_on(group: int, opcode: int, payload: bytes) -> None:
    for kind in (MessageType.RESPONSE, MessageType.NOTIFICATION):
        codec = HostCodec()
        codec.receive_data(encode_control(kind, group, opcode, payload) + encode_device_status(1))
        events = codec.events()
        assert len(events) == 2
        assert events[-1] == DeviceStatus(1)
        if isinstance(events[0], MalformedMessage):
            assert str(events[0].error)
    for codec, direction in ((HostCodec(), DataFormat.RECEIVE), (DeviceCodec(), DataFormat.SEND)):
        codec.receive_data(encode_data(direction, payload))
        assert len(codec.events()) == 1
    with contextlib.suppress(UciDecodeError):
        decode_device_info(payload)
    with contextlib.suppress(UciDecodeError):
        AppConfig.from_parameters(decode_parameters(payload))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(ParameterId), st.binary(max_size=17)), max_size=12))
def test_any_parameters_make_a_configuration_or_name_the_one_at_fault(raw: list[tuple[int, bytes]]) -> None:
    parameters = app().parameters() + raw
    assert decode_parameters(encode_parameters(parameters)) == parameters
    try:
        config = AppConfig.from_parameters(parameters)
    except UciParameterError as error:
        assert f"0x{error.parameter:02x}" in str(error)  # noqa: PT017 - either outcome is right
    else:
        assert AppConfig.from_parameters(config.parameters()) == config


@fast
@given(
    st.sampled_from(DeviceType),
    st.sampled_from(MultiNodeMode),
    st.lists(u16, min_size=1, max_size=8).map(tuple),
    u16,
    u32,
    st.sampled_from((16, 32)),
    st.booleans(),
)
def test_configurations_round_trip(
    kind: DeviceType, mode: MultiNodeMode, macs: tuple[int, ...], mac: int, interval: int, key: int, keyed: bool
) -> None:
    config = app(
        device_type=kind,
        multi_node_mode=mode,
        destination_macs=macs,
        mac_address=mac,
        interval_ms=interval,
        sts_config=StsConfig.PROVISIONED if keyed else StsConfig.STATIC,
        session_key=bytes(key) if keyed else None,
        extra=((0x2C, b"\x01"),),
    )
    assert AppConfig.from_parameters(decode_parameters(config.encode())) == config


@pytest.mark.parametrize(
    "changes",
    [
        {"destination_macs": ()},
        {"destination_macs": (0x10000,)},
        {"channel": 256},
        {"mac_address": -1},
        {"session_key": None},
        {"session_key": b"short"},
        {"sts_config": StsConfig.STATIC},
        {"extra": ((0x04, b"\x09"),)},
        {"extra": ((0x2C, bytes(256)),)},
    ],
)
def test_impossible_configurations_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(UciEncodeError):
        app(**changes)


@pytest.mark.parametrize(
    "raw",
    [b"", b"\x01", b"\x01\x00\x02\x00", b"\x00\x00", b"\x01\x00\x01\x00\x00"],
    ids=lambda raw: raw.hex() or "none",
)
def test_broken_parameter_lists(raw: bytes) -> None:
    with pytest.raises(UciDecodeError, match="parameters"):
        decode_parameters(raw)


def test_every_error_is_a_uci_error_and_status_codes_have_names() -> None:
    assert status_name(0x04) == "INVALID_PARAMETER (0x04)"
    assert status_name(0x7F) == "status 0x7f"
    for error in (UciEncodeError, UciDecodeError, UciParameterError):
        assert issubclass(error, UciError)
    with pytest.raises(UciDecodeError, match="measurement type 2"):
        decode_range_data(RANGE_NTF[4:17] + b"\x02" + RANGE_NTF[18:])
