"""The pad's receiver: who is attributed what, what floods and liars can do, and the two transports."""

from __future__ import annotations

import asyncio
import os
import socket
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs.records.sessions import BroadcastClaim
from wonderland.telemetry import ReceiverHealth, Track
from wonderland_edge_agent.receiver import Assembler, Heard, ReceiverError, ReceiverLimits, RemoteIdReceiver
from wonderland_remote_id import (
    BasicId,
    DescriptionType,
    HorizontalAccuracy,
    IdType,
    Location,
    Message,
    OperationalStatus,
    OperatorId,
    Pack,
    SelfId,
    System,
    encode,
)

T0 = 1_760_000_400_000
SERIAL = "1581F5FKD229400A1234"
OTHER = "1581F5FKD229400B9999"


def location(lat_e7: int = 601_700_000, **changes: object) -> Location:
    fields: dict[str, object] = {
        "lat_e7": lat_e7,
        "lon_e7": 249_400_000,
        "status": OperationalStatus.AIRBORNE,
        "altitude_mm": 40_000,
        "speed_mm_s": 5_000,
        "track_cdeg": 9_000,
        "vertical_mm_s": -500,
        "horizontal_accuracy": HorizontalAccuracy.M_3,
        "after_hour_ms": T0 % 3_600_000,
    }
    return Location(**{**fields, **changes})  # type: ignore[arg-type]


def pack(*messages: Message) -> bytes:
    return encode(Pack(messages=messages))


def feed(
    assembler: Assembler, frame: bytes | Message, now_ms: int = T0, source: str = "udp:10.0.0.1:1"
) -> Heard | None:
    data = frame if isinstance(frame, bytes) else encode(frame)
    return assembler.feed(data, source=source, transport="udp", now_ms=now_ms)


def test_a_pack_says_everything_at_once() -> None:
    assembler = Assembler(T0)
    heard = feed(
        assembler,
        pack(
            BasicId(uas_id=SERIAL),
            location(),
            System(operator_lat_e7=601_800_000, operator_lon_e7=249_500_000),
            OperatorId(operator_id="FIN87astrdge12k8-xyz"),
        ),
        T0 + 250,
    )
    assert heard == Heard(
        T0 + 250,
        Track(
            uav_id=SERIAL,
            lat_e7=601_700_000,
            lon_e7=249_400_000,
            transport="udp",
            height_mm=40_000,
            accuracy_mm=3_000,
            speed_mm_s=5_000,
            track_cdeg=9_000,
            vertical_mm_s=-500,
            status="airborne",
            operator_id="FIN87astrdge12k8",
            operator_lat_e7=601_800_000,
            operator_lon_e7=249_500_000,
            operator_place="takeoff",
            claim_t_ms=T0,
            latency_ms=250,
        ),
    )
    claims = assembler.recent(SERIAL, T0)
    assert claims == (heard.claim(),)
    assert BroadcastClaim.parse(claims[0].to_json()) == claims[0]


def test_what_the_operator_says_and_of_how_many_goes_with_the_track() -> None:
    assembler = Assembler(T0)
    emergency = SelfId(text="<b>Engine fire</b>", description_type=DescriptionType.EMERGENCY)
    group = System(area_count=3, area_radius_mm=120_000, area_ceiling_mm=90_000)
    track = feed(assembler, pack(BasicId(uas_id=SERIAL), location(), emergency, group)).track
    assert (track.description, track.description_type) == ("<b>Engine fire</b>", "emergency")
    assert (track.area_count, track.area_radius_mm, track.area_ceiling_mm) == (3, 120_000, 90_000)
    assert track.area_floor_mm is None
    private = pack(BasicId(uas_id=SERIAL), location(), SelfId(text="x", description_type=201), System())
    later = feed(assembler, private, T0 + 1_000).track
    assert (later.description, later.description_type) == ("x", "private")
    assert later.area_count is None, "one is no group"
    silent = pack(BasicId(uas_id=SERIAL), location(), SelfId(text="  "))
    assert feed(assembler, silent, T0 + 2_000).track.description is None


def test_single_messages_are_put_together_by_source() -> None:
    assembler = Assembler(T0)
    assert feed(assembler, location()) is None
    assert feed(assembler, BasicId(uas_id=SERIAL)) is None
    assert feed(assembler, OperatorId(operator_id="FIN87astrdge12k8")) is None
    heard = feed(assembler, location(), T0 + 1000)
    assert heard is not None
    assert (heard.track.uav_id, heard.track.operator_id) == (SERIAL, "FIN87astrdge12k8")
    assert feed(assembler, location(), source="udp:10.0.0.2:1") is None
    counts = assembler.counts
    assert (counts.frames, counts.unattributed, counts.heard, counts.bad, counts.drones) == (5, 2, 1, 0, 1)


def test_a_relay_that_mixes_drones_gives_positions_to_nobody() -> None:
    assembler = Assembler(T0)
    feed(assembler, BasicId(uas_id=SERIAL))
    feed(assembler, BasicId(uas_id=OTHER))
    assert feed(assembler, location()) is None
    assert assembler.counts.ambiguous == 1
    # A pack still says whose it is,
    heard = feed(assembler, pack(BasicId(uas_id=OTHER), location()))
    assert heard is not None
    assert heard.track.uav_id == OTHER
    # and when one of the two has been silent for longer than an identity lives, the other's positions count again.
    feed(assembler, BasicId(uas_id=SERIAL), T0 + 10_001)
    heard = feed(assembler, location(), T0 + 10_002)
    assert heard is not None
    assert heard.track.uav_id == SERIAL


def test_an_identity_that_is_not_repeated_ends() -> None:
    assembler = Assembler(T0)
    feed(assembler, BasicId(uas_id=SERIAL))
    assert feed(assembler, location(), T0 + 10_000) is not None
    assert feed(assembler, location(), T0 + 10_001) is None


def test_the_serial_number_is_preferred() -> None:
    assembler = Assembler(T0)
    session = BasicId(uas_id="01" + "ab" * 19, id_type=IdType.SPECIFIC_SESSION)
    heard = feed(assembler, pack(session, BasicId(uas_id=SERIAL), location()))
    assert heard is not None
    assert heard.track.uav_id == SERIAL
    heard = feed(assembler, pack(session, location()), source="udp:10.0.0.2:1")
    assert heard is not None
    assert heard.track.uav_id == session.uas_id


@pytest.mark.parametrize("uas_id", ["", " ", "../etc", "a b", "-x"])
def test_names_that_no_registry_has_are_no_identity(uas_id: str) -> None:
    assembler = Assembler(T0)
    assert feed(assembler, pack(BasicId(uas_id=uas_id), location())) is None
    assert assembler.counts.unattributed == 1


def test_a_position_that_is_unknown_is_none() -> None:
    assembler = Assembler(T0)
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), Location())) is None
    assert assembler.recent(SERIAL, 0) == ()


def test_ten_nautical_miles_are_as_good_as_unknown() -> None:
    heard = feed(Assembler(T0), pack(BasicId(uas_id=SERIAL), location(horizontal_accuracy=HorizontalAccuracy.NM_10)))
    assert heard is not None
    assert heard.track.accuracy_mm is None
    assert BroadcastClaim.parse(heard.claim().to_json()) == heard.claim()


def test_recent_is_in_order_and_bounded() -> None:
    assembler = Assembler(T0)
    assembler.watch(SERIAL)
    for index in range(1_000):
        feed(assembler, pack(BasicId(uas_id=SERIAL), location(601_700_000 + index)), T0 + 50 * index)
    claims = assembler.recent(SERIAL, T0 + 10_000)
    assert len(claims) == 800, "the session chooses, not the receiver"
    assert list(claims) == sorted(claims, key=lambda claim: claim.t_ms)
    assert claims[-1].lat_e7 == 601_700_999
    assert assembler.recent(SERIAL, T0 + 10**9) == ()
    assert assembler.recent("nobody", 0) == ()
    assembler.unwatch(SERIAL)
    assert len(assembler.recent(SERIAL, 0)) == ReceiverLimits().history


def test_a_flood_of_drones_does_not_push_out_the_one_that_is_proved() -> None:
    assembler = Assembler(T0)
    assembler.watch(SERIAL)
    feed(assembler, pack(BasicId(uas_id=SERIAL), location()))
    tracemalloc.start()
    try:
        for index in range(6_000):
            frame = pack(BasicId(uas_id=f"X{index}"), location())
            feed(assembler, frame, T0 + index * 6, source=f"udp:10.0.0.1:{index}")
        size, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert size < 3_000_000
    assert assembler.counts.drones == ReceiverLimits().drones
    assert assembler.counts.limited > 5_000
    assert len(assembler.recent(SERIAL, T0)) == 1
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), location()), T0 + 50_000) is not None


def test_a_watched_drone_is_taken_even_while_new_ones_come_too_fast() -> None:
    assembler = Assembler(T0)
    for index in range(100):
        feed(assembler, pack(BasicId(uas_id=f"X{index}"), location()))
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), location())) is None
    assembler.watch(SERIAL)
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), location())) is not None


def test_one_source_cannot_have_all_the_time() -> None:
    assembler = Assembler(T0)
    for _ in range(5_000):
        feed(assembler, b"garbage", source="udp:10.9.9.9:9")
    # Each source has its own rate, below that of all together; the garbage left the rest to others.
    limits = ReceiverLimits()
    assert assembler.counts.bad == limits.frames_per_source_s
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), location()), T0 + 1_000) is not None


def test_one_drone_cannot_fill_the_history_faster_than_its_rate() -> None:
    assembler = Assembler(T0)
    heard = [feed(assembler, pack(BasicId(uas_id=SERIAL), location()), T0 + index) for index in range(200)]
    assert sum(one is not None for one in heard) <= 25 + 5


def test_a_clock_that_steps_back_stops_nothing() -> None:
    assembler = Assembler(T0)
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), location()), T0) is not None
    assert feed(assembler, pack(BasicId(uas_id=SERIAL), location()), T0 - 3_600_000) is not None
    times = [claim.t_ms for claim in assembler.recent(SERIAL, 0)]
    assert times == sorted(times)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.binary(max_size=60), st.integers(0, 3), st.integers(0, 100_000)), max_size=30))
def test_garbage_is_counted_and_hurts_nobody(frames: list[tuple[bytes, int, int]]) -> None:
    assembler = Assembler(T0)
    for frame, source, at in frames:
        feed(assembler, frame, T0 + at, source=str(source))
    assert assembler.counts.frames == len(frames)


# The shell


async def until(condition: object, timeout_s: float = 5.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():  # type: ignore[operator]
            await asyncio.sleep(0.005)


async def test_datagrams() -> None:
    heard: list[Heard] = []
    receiver = RemoteIdReceiver(listen=("127.0.0.1", 0), on_heard=heard.append, clock_ms=lambda: T0)
    with pytest.raises(ReceiverError):
        _ = receiver.address
    await receiver.start()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for frame in (b"", b"garbage", encode(BasicId(uas_id=SERIAL)), encode(location())):
                sender.sendto(frame, receiver.address)
            await until(lambda: receiver.counts.frames == 4)
        assert [one.track.uav_id for one in heard] == [SERIAL]
        assert receiver.counts.bad == 2
        assert receiver.counts.health() == ReceiverHealth(frames=4, bad=2)
        assert receiver.recent(SERIAL, T0) == (heard[0].claim(),)
        second = RemoteIdReceiver(listen=receiver.address)
        with pytest.raises(ReceiverError, match="cannot listen on UDP"):
            await second.start()
    finally:
        await receiver.close()


async def test_a_callback_that_fails_does_not_end_the_receiver() -> None:
    heard: list[Heard] = []
    faults: list[dict[str, object]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: faults.append(context))

    def on_heard(one: Heard) -> None:
        heard.append(one)
        raise RuntimeError("spool is gone")

    receiver = RemoteIdReceiver(listen=("127.0.0.1", 0), on_heard=on_heard, clock_ms=lambda: T0)
    await receiver.start()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(2):
                sender.sendto(pack(BasicId(uas_id=SERIAL), location()), receiver.address)
            await until(lambda: len(heard) == 2)
    finally:
        await receiver.close()
    assert len(faults) == 2


async def test_serial_lines_survive_garbage_and_unplugging() -> None:
    heard: list[Heard] = []
    masters: list[int] = []

    class End:
        """The receiver's end of a pseudo-terminal."""

        def __init__(self) -> None:
            master, self._fd = os.openpty()
            os.set_blocking(self._fd, False)
            import tty

            tty.setraw(self._fd)
            masters.append(master)

        def fileno(self) -> int:
            return self._fd

        def close(self) -> None:
            os.close(self._fd)

    receiver = RemoteIdReceiver(serial_ports=[End], on_heard=heard.append, clock_ms=lambda: T0)
    await receiver.start()
    try:
        frame = pack(BasicId(uas_id=SERIAL), location()).hex().encode()
        os.write(masters[0], b"\xff\xfe\nnot hex\n" + frame[:40])
        await until(lambda: receiver.counts.bad == 2)
        os.write(masters[0], frame[40:] + b"\r\n\r\n")
        await until(lambda: len(heard) == 1)
        os.write(masters[0], b"0" * 3_000 + b"\n")  # one endless line is one bad frame, and costs no memory
        await until(lambda: receiver.counts.bad == 3)
        here, there = encode(location(601_700_100)), encode(location(601_700_200))
        for index, data in enumerate([encode(BasicId(uas_id=SERIAL)), encode(BasicId(uas_id=OTHER)), here, there]):
            address = f"02:00:00:00:00:0{index % 2}"
            os.write(masters[0], f"{address} -70 {data.hex()}\n".encode())
        await until(lambda: len(heard) == 3)
        assert [(one.track.uav_id, one.track.rssi) for one in heard[1:]] == [(SERIAL, -70), (OTHER, -70)]
        assert {one.track.transport for one in heard} == {"serial"}
        os.close(masters[0])  # unplugged
        await until(lambda: len(masters) == 2)
        os.write(masters[1], frame + b"\n")
        await until(lambda: len(heard) == 4)
    finally:
        await receiver.close()
        for master in masters[1:]:
            os.close(master)
