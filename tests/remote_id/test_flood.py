"""Who floods a pad with a drone's serial number: what the drone itself sends is heard all the same."""

from __future__ import annotations

import itertools

import pytest

from wonderland_edge_agent.receiver import Assembler, ReceiverLimits
from wonderland_remote_id import BasicId, IdType, Location, Message, Pack, encode

T0 = 1_760_000_400_000
SERIAL, OTHER = "1581F5FKD229400A1234", "1581F5FKD229400B9999"
OWN_LAT, LIE_LAT = 601_700_000, 601_710_000


def frame(lat_e7: int, t_ms: int, uav_id: str = SERIAL) -> bytes:
    place = Location(lat_e7=lat_e7, lon_e7=249_400_000, after_hour_ms=t_ms % 3_600_000 // 100 * 100)
    return encode(Pack(messages=(BasicId(uas_id=uav_id), place)))


class Air:
    """One honest transmitter, once a second, and somebody else."""

    def __init__(self, *, watched: bool = True) -> None:
        self.assembler = Assembler(T0)
        if watched:
            self.assembler.watch(SERIAL)
        self.kept: list[int] = []
        self.told = 0

    def play(self, first_ms: int, last_ms: int, per_ms: int, sources) -> None:
        """``per_ms`` frames of the flooder each millisecond; ``sources`` says from where. The session listens."""
        for t_ms in range(T0 + first_ms, T0 + last_ms):
            for _ in range(per_ms):
                data = frame(LIE_LAT + t_ms % 997, t_ms)
                heard = self.assembler.feed(data, source=next(sources), transport="ble4", now_ms=t_ms)
                self.told += heard is not None
            if t_ms % 1_000 == 500:
                self.assembler.feed(frame(OWN_LAT, t_ms), source="ble:own", transport="ble4", now_ms=t_ms)
            if t_ms % 100 == 99:
                fresh = self.assembler.recent(SERIAL, t_ms - 99)
                self.kept += [claim.t_ms for claim in fresh if claim.lat_e7 == OWN_LAT]


FEW = [lambda: itertools.repeat("ble:x"), lambda: itertools.cycle([f"ble:x{number}" for number in range(8)])]
MANY = [lambda: (f"ble:{number}" for number in itertools.count())]


@pytest.mark.parametrize("sources", [*FEW, *MANY], ids=["one", "eight", "ever new"])
@pytest.mark.parametrize("per_ms", [1, 4])
def test_a_drone_that_was_there_before_the_flood_is_heard(sources, per_ms):
    air = Air()
    air.play(0, 3_000, 0, iter(()))
    air.play(3_000, 9_000, per_ms, sources())
    assert len(air.kept) == 9


@pytest.mark.parametrize("sources", FEW, ids=["one", "eight"])
def test_a_drone_that_comes_into_the_flood_of_a_few_transmitters_is_heard(sources):
    air = Air()
    air.play(0, 6_000, 1, sources())
    assert len(air.kept) >= 5


def test_a_flood_is_not_told_on():
    """The backend gets no more of one drone than before."""
    air = Air()
    air.play(0, 4_000, 1, (f"ble:{number}" for number in itertools.count()))
    assert air.told <= ReceiverLimits().positions_per_drone_s * 5


def test_one_transmitter_leaves_room_for_the_drone_where_nobody_proves_anything():
    air = Air(watched=False)
    air.play(0, 5_000, 1, itertools.repeat("ble:x"))
    assert len(air.kept) >= 4


def single(assembler: Assembler, message: Message, t_ms: int) -> None:
    assembler.feed(encode(message), source="ble:own", transport="ble4", now_ms=t_ms)


def test_what_is_sent_under_the_drones_address_with_another_name_takes_nothing_away():
    """Its positions are given to nobody; but the session can see whether the drone attested them."""
    assembler = Assembler(T0)
    assembler.watch(SERIAL)
    single(assembler, BasicId(uas_id=SERIAL, id_type=IdType.SERIAL_NUMBER), T0)
    single(assembler, Location(lat_e7=OWN_LAT, lon_e7=1, after_hour_ms=0), T0 + 10)
    single(assembler, BasicId(uas_id=OTHER, id_type=IdType.SERIAL_NUMBER), T0 + 20)
    single(assembler, Location(lat_e7=OWN_LAT, lon_e7=2, after_hour_ms=1_000), T0 + 1_000)
    assert [claim.lon_e7 for claim in assembler.recent(SERIAL, T0)] == [1]
    assert [claim.lon_e7 for claim in assembler.unsure(SERIAL, T0)] == [2]
    assert assembler.unsure(OTHER, T0) == assembler.unsure("nobody", T0) == ()
    assert assembler.unsure(SERIAL, T0 + 2_000) == ()
