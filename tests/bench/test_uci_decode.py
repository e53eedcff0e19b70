"""How fast a pad reads its nodes: octets of RANGE_DATA_NTF in, typed records out."""

from __future__ import annotations

import time

import pytest

from wonderland.uwb.uci.codec import HostCodec
from wonderland.uwb.uci.packets import MessageType, encode_control
from wonderland.uwb.uci.ranging import RangeData, TwoWayMeasurement, encode_range_data

GOAL_PER_S = 100_000


@pytest.mark.bench
@pytest.mark.parametrize("records", [1, 4])
def test_notifications_per_second(records: int, record_property) -> None:
    measurements = tuple(TwoWayMeasurement(0xD001 + i, 0, 0, 500 + i) for i in range(records))
    packet = encode_control(
        MessageType.NOTIFICATION, 2, 0, encode_range_data(RangeData(7, 1, 0, 50, 1, 0, measurements))
    )
    best = 0.0
    for _ in range(5):
        codec = HostCodec()
        count = 0
        started = time.perf_counter()
        for _ in range(20_000):
            codec.receive_data(packet)
            count += len(codec.events())
        best = max(best, count / (time.perf_counter() - started))
    record_property("notifications_per_s", round(best))
    print(f"{records} records: {best:,.0f} notifications/s")
    assert best >= GOAL_PER_S
