"""Tracks over several transports, and what is odd: honest drones cause nothing, liars what they are named for."""

from __future__ import annotations

import random

import pytest

from wonderland import telemetry
from wonderland_edge_agent.receiver import Assembler, Finding
from wonderland_edge_agent.receiver.findings import AGAIN_MS, FindingGate
from wonderland_remote_id import BasicId, HorizontalAccuracy, Location, Pack, encode

T0 = 1_760_000_400_000
SERIAL, OTHER = "1581F5FKD229400A1234", "1581F5FKD229400B9999"
BLE, NAN = ("ble:a", "ble4"), ("wifi:b", "wifi-nan")


def frame(east_m: float = 0, t_ms: int | None = T0, uav_id: str = SERIAL, **more) -> bytes:
    place = Location(
        lat_e7=0 + 10_000_000,
        lon_e7=10_000_000 + round(east_m * 89.93),
        horizontal_accuracy=HorizontalAccuracy.M_3,
        after_hour_ms=None if t_ms is None else t_ms % 3_600_000 // 100 * 100,
        **more,
    )
    return encode(Pack(messages=(BasicId(uas_id=uav_id), place)))


class Pad:
    def __init__(self) -> None:
        self.assembler = Assembler(T0)
        self.found: list[Finding] = []

    def hear(self, data: bytes, now_ms: int, way: tuple[str, str] = BLE, **more):
        heard = self.assembler.feed(data, source=way[0], transport=way[1], now_ms=now_ms, **more)
        self.found += self.assembler.findings()
        return heard

    @property
    def kinds(self) -> list[str]:
        return [finding.body.kind for finding in self.found]


def test_one_message_over_two_transports_is_one_position() -> None:
    pad = Pad()
    assert pad.hear(frame(), T0 + 100).track.lost is None
    assert pad.hear(frame(), T0 + 400, NAN) is None
    second = pad.hear(frame(5, T0 + 1_000), T0 + 1_200, NAN)
    assert (second.track.duplicates, second.track.transports, second.track.latency_ms) == (1, ("ble4", "wifi-nan"), 200)
    assert pad.assembler.counts.duplicates == 1
    assert len(pad.assembler.recent(SERIAL, T0)) == 2
    assert pad.hear(frame(5, T0 + 1_000), T0 + 13_000).track.transports is None, "one is said by `transport`"


def test_gaps_in_the_counters() -> None:
    pad = Pad()
    for step, (counter, lost) in enumerate([(250, 0), (251, 0), (254, 2), (1, 4), (0, 4), (3, 5), (3, 5)]):
        heard = pad.hear(frame(step, T0 + 1_000 * step), T0 + 1_000 * step, counter=counter)
        assert (heard.track.lost or 0) == lost, counter
    pad.hear(frame(9, T0 + 60_000), T0 + 60_000, counter=100)
    assert pad.assembler.counts.lost == 5, "after a silence nothing follows from a counter"
    # The same counter with the same content from the same transmitter is the same message.
    assert pad.hear(frame(9, T0 + 60_000), T0 + 60_030, counter=100) is None


@pytest.mark.parametrize("seed", range(20))
def test_an_honest_drone_on_three_transports_causes_nothing(seed) -> None:
    rng, pad = random.Random(seed), Pad()
    heard_ms = T0
    for step in range(120):
        t_ms = T0 + 1_000 * step
        east_m = 30 * step + rng.gauss(0, 2)
        data = frame(east_m, t_ms)
        for way in (BLE, NAN, ("wifi:c", "wifi-beacon")):
            if rng.random() < 0.7:
                heard_ms = max(heard_ms, t_ms) + rng.randrange(0, 150)
                pad.hear(data, heard_ms, way)
    assert pad.found == []
    assert pad.assembler.counts.heard > 100


def test_one_serial_from_two_places() -> None:
    pad = Pad()
    pad.hear(frame(0), T0)
    pad.hear(frame(2_000, T0 + 500), T0 + 500, NAN)
    [finding] = [each.body for each in pad.found]
    assert (finding.kind, finding.transport, finding.other_transport) == ("two_places", "wifi-nan", "ble4")
    assert 1_990_000 < finding.distance_mm < 2_010_000
    assert finding.interval_ms == 500


def test_faster_than_anything_flies() -> None:
    pad = Pad()
    pad.hear(frame(0), T0)
    pad.hear(frame(140, T0 + 1_000), T0 + 1_000)
    assert pad.found == []
    pad.hear(frame(1_000, T0 + 2_000), T0 + 2_000)
    assert pad.kinds == ["impossible_speed"]


def test_time_that_does_not_advance() -> None:
    pad = Pad()
    for step in range(8):
        pad.hear(frame(step, T0), T0 + 1_000 * step)
    assert pad.kinds == ["time_stuck"]
    assert pad.found[0].body.interval_ms >= 5_000


def test_time_that_goes_back_is_a_replay() -> None:
    pad = Pad()
    pad.hear(frame(0, T0 + 10_000), T0 + 10_000)
    pad.hear(frame(1, T0), T0 + 11_000)
    assert "time_backwards" in pad.kinds


def test_time_that_is_not_ours() -> None:
    pad = Pad()
    pad.hear(frame(0, T0 - 60_000), T0)
    assert pad.kinds == ["time_off"]
    assert pad.found[0].body.interval_ms == 60_000


def test_one_transmitter_with_several_serials() -> None:
    pad = Pad()
    pad.hear(frame(0), T0, address="02:00:00:00:00:01")
    pad.hear(frame(0, uav_id=OTHER), T0 + 500, address="02:00:00:00:00:01")
    assert pad.kinds == ["several_identities"]
    assert (pad.found[0].body.uav_id, pad.found[0].body.other_uav_id) == (OTHER, SERIAL)
    relay = Pad()  # a relay, which tells no transmitter's address, may well hear two drones
    relay.hear(frame(0), T0)
    relay.hear(frame(0, uav_id=OTHER), T0 + 500)
    assert relay.found == []


def test_more_positions_than_any_drone_sends() -> None:
    pad = Pad()
    for step in range(60):
        pad.hear(frame(step / 100, T0 + 10 * step), T0 + 10 * step)
    assert pad.kinds == ["rate_high"]


def test_a_finding_is_told_once_a_minute_with_its_count() -> None:
    gate = FindingGate()
    for step in range(100):
        gate.put(Finding(T0 + 1_000 * step, telemetry.Finding(uav_id=SERIAL, kind="time_off")))
    told = gate.take_findings()
    assert [(finding.t_ms, finding.body.count) for finding in told] == [(T0, 1), (T0 + AGAIN_MS, 60)]
    for step in range(5_000):
        gate.put(Finding(T0, telemetry.Finding(uav_id=f"drone-{step}", kind="time_off")))
    assert len(gate.take_findings()) <= 1_024
