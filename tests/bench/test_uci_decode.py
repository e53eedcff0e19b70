"""How fast a pad reads its nodes: octets of RANGE_DATA_NTF in, typed records out; beside bare struct of the same octets."""

from __future__ import annotations

import struct
import time

import pytest
from bench.bench_tools import show

from wonderland_fira_uci.uci.codec import HostCodec
from wonderland_fira_uci.uci.packets import MessageType, encode_control
from wonderland_fira_uci.uci.ranging import RangeData, TwoWayMeasurement, encode_range_data

PACKETS = 20_000
REPEAT = 5
HEAD = 4 + 25
RECORD = struct.Struct("<HBBHhBhBhBhBBB11x")

pytestmark = pytest.mark.bench


def best_per_s(work):
    """Packets per second of the best of some runs."""
    best = 0.0
    for _ in range(REPEAT):
        started = time.perf_counter()
        work()
        best = max(best, PACKETS / (time.perf_counter() - started))
    return best


def test_notifications_per_second(keep):
    rows = []
    for records in (1, 4):
        measurements = tuple(TwoWayMeasurement(0xD001 + i, 0, 0, 500 + i) for i in range(records))
        packet = encode_control(
            MessageType.NOTIFICATION, 2, 0, encode_range_data(RangeData(7, 1, 0, 50, 1, 0, measurements))
        )
        assert [each[0] for each in RECORD.iter_unpack(packet[HEAD:])] == [each.mac_address for each in measurements]

        def decode(packet=packet, measurements=measurements):
            codec = HostCodec()
            count = 0
            for _ in range(PACKETS):
                codec.receive_data(packet)
                (event,) = codec.events()
                count += len(event.two_way)
            assert count == PACKETS * len(measurements)
            assert tuple(event.two_way) == measurements

        def bare(packet=packet):
            for _ in range(PACKETS):
                list(RECORD.iter_unpack(packet[HEAD:]))

        decoded, floor = best_per_s(decode), best_per_s(bare)
        rows.append((records, f"{decoded:,.0f}", f"{floor:,.0f}", f"{decoded / floor:.2f}"))
        keep(records=records, notifications_per_s=round(decoded), floor_per_s=round(floor))
    show(
        "RANGE_DATA_NTF, octets → checked, typed records (goal ≥ 100,000/s)",
        ("records", "notifications/s", "bare struct/s", "ratio"),
        rows,
    )
