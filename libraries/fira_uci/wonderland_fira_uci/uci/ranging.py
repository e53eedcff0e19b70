"""RANGE_DATA_NTF: what a node measured in one round. Decoded on the hot path, so records are named tuples.

Source: FiRa UCI, "RANGE_DATA_NTF": 24 octets of header, a count, then records; a two-way record has 31 octets with
short as with extended addresses. Little-endian; distances in centimetres; angles in Q9.7 degrees.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple

from wonderland_fira_uci.uci.errors import UciDecodeError, UciEncodeError
from wonderland_fira_uci.uci.status import Status

_HEADER: Final = struct.Struct("<IIBIBBB8xB")
_SHORT: Final = struct.Struct("<HBBHhBhBhBhBBB11x")
_EXTENDED: Final = struct.Struct("<QBBHhBhBhBhBBB5x")
_ONE_WAY_SHORT: Final = struct.Struct("<HBBhBhBQI12x")
_ONE_WAY_EXTENDED: Final = struct.Struct("<QBBhBhBQI12x")
INVALID_DISTANCE_CM: Final = 0xFFFF
MAX_RECORDS: Final = 0xFF
TICK_S: Final = 1 / (128 * 499.2e6)
"""Seconds per time-stamp tick: 15.65 ps, 4.7 mm of light."""
CLOCK_BITS: Final = 40
"""The counter behind a time stamp begins anew every 17.2 s."""


class MeasurementType(IntEnum):
    """Type octet of the notification."""

    ONE_WAY = 0
    TWO_WAY = 1


class FrameType(IntEnum):
    """What an uplink TDoA anchor time-stamped."""

    BLINK = 0
    SYNCHRONISATION = 1


class LineOfSight(IntEnum):
    """NLOS octet of a record."""

    CLEAR = 0x00
    OBSTRUCTED = 0x01
    UNDETERMINED = 0xFF


class TwoWayMeasurement(NamedTuple):
    """One peer of a two-way round, fields as on the wire."""

    mac_address: int
    status: int
    nlos: int
    distance_cm: int
    azimuth_q7: int = 0
    azimuth_fom: int = 0
    elevation_q7: int = 0
    elevation_fom: int = 0
    destination_azimuth_q7: int = 0
    destination_azimuth_fom: int = 0
    destination_elevation_q7: int = 0
    destination_elevation_fom: int = 0
    slot_index: int = 0
    rssi: int = 0

    @property
    def range_mm(self) -> int | None:
        """Millimetres (multiples of ten), None when the round failed or the node gave no distance."""
        if self.status != Status.OK or self.distance_cm == INVALID_DISTANCE_CM:
            return None
        return self.distance_cm * 10

    @property
    def obstructed(self) -> bool | None:
        """Whether the node thinks that the direct path is blocked; None when it cannot tell."""
        return None if self.nlos not in (LineOfSight.CLEAR, LineOfSight.OBSTRUCTED) else bool(self.nlos)

    @property
    def rssi_dbm(self) -> float | None:
        """Received power in half decibels below a milliwatt; None for 0 and 255, which nodes send without a value."""
        return None if self.rssi in (0x00, 0xFF) else -self.rssi / 2


class OneWayMeasurement(NamedTuple):
    """One frame of a tag or synchronisation anchor as an uplink TDoA anchor time-stamped it.

    ``timestamp_ticks`` counts ``TICK_S`` on the anchor's clock.
    """

    mac_address: int
    frame_type: int
    nlos: int
    azimuth_q7: int
    azimuth_fom: int
    elevation_q7: int
    elevation_fom: int
    timestamp_ticks: int
    frame_number: int
    device_info: bytes = b""
    blink_payload: bytes = b""

    @property
    def obstructed(self) -> bool | None:
        """Whether the anchor thinks that the direct path is blocked; None when it cannot tell."""
        return None if self.nlos not in (LineOfSight.CLEAR, LineOfSight.OBSTRUCTED) else bool(self.nlos)


class RangeData(NamedTuple):
    """One RANGE_DATA_NTF. Exactly one of the two tuples may be filled, by ``measurement_type``."""

    sequence: int
    handle: int
    rcr_indicator: int
    interval_ms: int
    measurement_type: int
    extended_addresses: int
    two_way: tuple[TwoWayMeasurement, ...] = ()
    one_way: tuple[OneWayMeasurement, ...] = ()


_new = tuple.__new__


def decode_range_data(payload: bytes) -> RangeData:
    """Raises ``UciDecodeError`` when lengths, types or modes contradict each other."""
    size = len(payload)
    if size < _HEADER.size:
        raise UciDecodeError(f"RANGE_DATA_NTF: {size} octets; its header alone has {_HEADER.size}")
    sequence, handle, rcr, interval_ms, kind, _, mode, count = _HEADER.unpack_from(payload)
    if mode > 1:
        raise UciDecodeError(f"RANGE_DATA_NTF: address mode {mode} is not defined")
    if kind == MeasurementType.TWO_WAY:
        record = _EXTENDED if mode else _SHORT
        expected = _HEADER.size + count * record.size
        if size != expected:
            raise UciDecodeError(f"RANGE_DATA_NTF: {count} two-way records need {expected} octets, {size} came")
        records: tuple[TwoWayMeasurement, ...]
        if count == 1:
            records = (_new(TwoWayMeasurement, record.unpack_from(payload, _HEADER.size)),)
        else:
            records = tuple([_new(TwoWayMeasurement, r) for r in record.iter_unpack(payload[_HEADER.size :])])
        return _new(RangeData, (sequence, handle, rcr, interval_ms, kind, mode, records, ()))
    if kind == MeasurementType.ONE_WAY:
        one_way = _decode_one_way(payload, count, _ONE_WAY_EXTENDED if mode else _ONE_WAY_SHORT)
        return RangeData(sequence, handle, rcr, interval_ms, kind, mode, (), one_way)
    raise UciDecodeError(f"RANGE_DATA_NTF: measurement type {kind} is not supported; use two-way ranging or UL-TDoA")


def _decode_one_way(payload: bytes, count: int, record: struct.Struct) -> tuple[OneWayMeasurement, ...]:
    at = _HEADER.size
    out: list[OneWayMeasurement] = []
    for index in range(count):
        if at + record.size > len(payload):
            raise UciDecodeError(f"RANGE_DATA_NTF: one-way record {index + 1} of {count} ends beyond the payload")
        fields = record.unpack_from(payload, at)
        at += record.size
        blobs: list[bytes] = []
        for name in ("device information", "blink payload"):
            length = payload[at] if at < len(payload) else -1
            if length < 0 or at + 1 + length > len(payload):
                raise UciDecodeError(f"RANGE_DATA_NTF: {name} of record {index + 1} ends beyond the payload")
            blobs.append(payload[at + 1 : at + 1 + length])
            at += 1 + length
        out.append(OneWayMeasurement(*fields, *blobs))
    if at != len(payload):
        raise UciDecodeError(f"RANGE_DATA_NTF: {len(payload) - at} octets follow the last of {count} records")
    return tuple(out)


def encode_range_data(report: RangeData) -> bytes:
    """Reverse of ``decode_range_data``; raises ``UciEncodeError`` on values that do not fit."""
    one_way = report.measurement_type == MeasurementType.ONE_WAY
    records = report.one_way if one_way else report.two_way
    if len(records) > MAX_RECORDS:
        raise UciEncodeError(f"RANGE_DATA_NTF: {len(records)} records; at most {MAX_RECORDS} fit")
    try:
        out = [
            _HEADER.pack(
                report.sequence,
                report.handle,
                report.rcr_indicator,
                report.interval_ms,
                report.measurement_type,
                0,
                report.extended_addresses,
                len(records),
            )
        ]
        if one_way:
            layout = _ONE_WAY_EXTENDED if report.extended_addresses else _ONE_WAY_SHORT
            for blink in report.one_way:
                info, text = blink.device_info, blink.blink_payload
                out.append(layout.pack(*blink[:9]) + bytes((len(info),)) + info + bytes((len(text),)) + text)
        else:
            layout = _EXTENDED if report.extended_addresses else _SHORT
            out.extend([layout.pack(*measurement) for measurement in report.two_way])
    except (struct.error, ValueError) as error:
        raise UciEncodeError(f"RANGE_DATA_NTF: {error}") from error
    return b"".join(out)
