"""The drone signs for what it broadcasts: its module's messages, the list over the link, and whole proofs with it."""

from __future__ import annotations

import asyncio
import dataclasses
import socket

import pytest

from wonderland.attested import attested_position, stated_accuracy_mm
from wonderland.proofs.attestation import digest_of
from wonderland.proofs.encoding import from_base64url, to_base64url
from wonderland.proofs.records.sessions import MAX_ATTESTED, BroadcastClaim
from wonderland.uwb.link.errors import PayloadError
from wonderland.uwb.link.messages import MAX_DIGESTS, MessageType, decode_attested, encode_attested
from wonderland_remote_id import BasicId, HorizontalAccuracy, IdType, Location, Pack, decode, encode
from wonderland_remote_id.framings import mavlink
from wonderland_uav_agent.broadcasts import BroadcastError, NoBroadcasts, RemoteIdModule

HOUR_MS = 3_600_000
NOW_MS = 1_800_000_000_000
MM_PER_LON_E7 = 5.49
"""At the latitude of these tests' pad."""
PLACE = {"lat_e7": 604_518_123, "lon_e7": 222_666_321}


def frame(t_ms, *, serial=None, accuracy=HorizontalAccuracy.M_3, **more):
    location = Location(**(PLACE | {"after_hour_ms": t_ms % HOUR_MS, "horizontal_accuracy": accuracy} | more))
    if serial is None:
        return encode(location)
    return encode(Pack(messages=(BasicId(uas_id=serial, id_type=IdType.SERIAL_NUMBER), location)))


# --- the list over the link --------------------------------------------------------------------------------------


def test_a_list_goes_over_the_link_as_it_is():
    digests = tuple(bytes((number,)) * 8 for number in range(MAX_DIGESTS))
    assert decode_attested(encode_attested(digests)) == digests
    assert MAX_DIGESTS == MAX_ATTESTED


@pytest.mark.parametrize("digests", [(), (b"1234567",), (b"12345678",) * (MAX_DIGESTS + 1)])
def test_no_other_list_is_sent(digests):
    with pytest.raises(PayloadError, match=r"attested|digest"):
        encode_attested(digests)


@pytest.mark.parametrize("payload", [b"", b"1234567", b"123456789", b"x" * 8 * (MAX_DIGESTS + 1)])
def test_no_other_list_is_taken(payload):
    with pytest.raises(PayloadError, match="attested"):
        decode_attested(payload)


# --- the module --------------------------------------------------------------------------------------------------


@pytest.fixture
def module():
    return RemoteIdModule(("127.0.0.1", 0), "uav-1", lambda: NOW_MS)


def heard(octets, heard_ms):
    """What a pad makes of the same octets."""
    decoded = decode(octets)
    location = decoded.messages[-1] if isinstance(decoded, Pack) else decoded
    said = attested_position(location, heard_ms)
    return BroadcastClaim(
        lat_e7=location.lat_e7,
        lon_e7=location.lon_e7,
        t_ms=heard_ms,
        accuracy_mm=stated_accuracy_mm(location),
        said_ms=None if said is None else said[0],
    )


@pytest.mark.parametrize("accuracy", list(HorizontalAccuracy))
@pytest.mark.parametrize("wrap", [None, "uav-1", "mavlink"])
def test_what_the_module_sends_is_what_the_pad_hears(module, accuracy, wrap):
    octets = frame(NOW_MS - 300, serial="uav-1" if wrap == "uav-1" else None, accuracy=accuracy)
    module.take_datagram(mavlink.build_frame(octets) if wrap == "mavlink" else octets)
    assert [to_base64url(digest) for digest in module.sent(0)] == [digest_of(heard(octets, NOW_MS + 900))]


def test_messages_over_the_full_hour_have_one_time():
    hour_ms = NOW_MS - NOW_MS % HOUR_MS
    module = RemoteIdModule(("127.0.0.1", 0), "uav-1", lambda: hour_ms + 20)
    octets = frame(hour_ms - 100)
    module.take_datagram(octets)
    assert [to_base64url(digest) for digest in module.sent(0)] == [digest_of(heard(octets, hour_ms - 10))]


def test_what_is_not_this_drones_or_not_dated_by_its_clock_is_not_attested(module):
    module.take_datagram(frame(NOW_MS, serial="uav-2"))
    module.take_datagram(frame(NOW_MS + 900))
    module.take_datagram(frame(NOW_MS - 1_900))
    module.take_datagram(encode(Location(**PLACE)))
    module.take_datagram(frame(NOW_MS, lat_e7=None, lon_e7=None))
    module.take_datagram(encode(BasicId(uas_id="uav-1", id_type=IdType.SERIAL_NUMBER)))
    module.take_datagram(b"\xff" * 25)
    module.take_datagram(b"")
    assert module.sent(0) == ()
    assert (module.foreign, module.undated, module.bad, module.datagrams) == (1, 4, 2, 8)


def test_the_list_has_each_position_once_in_order_and_from_the_session_on():
    now = [NOW_MS]
    module = RemoteIdModule(("127.0.0.1", 0), "uav-1", lambda: now[0])
    for second in range(400):
        now[0] = NOW_MS + second * 1_000
        module.take_datagram(frame(now[0]))
        module.take_datagram(frame(now[0]))
    assert len(module.sent(now[0] - 5_000)) == 6
    assert len(module.sent(0)) <= 256
    assert module.sent(now[0] + 1) == NoBroadcasts().sent(0) == ()


async def test_the_module_speaks_by_udp(module):
    async with module:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(frame(NOW_MS), module.address)
        while not module.datagrams:
            await asyncio.sleep(0.005)
        assert len(module.sent(0)) == 1
        with pytest.raises(BroadcastError, match="cannot listen"):
            async with RemoteIdModule(module.address, "uav-1", lambda: NOW_MS):
                pass
    with pytest.raises(BroadcastError, match="not open"):
        _ = module.address


# --- both machines ------------------------------------------------------------------------------------------------


class Told:
    """A drone that broadcasts five times a second what ``off_mm`` says, and a pad that hears it and an impostor."""

    def __init__(self, flight, *, off_mm=0, attest=True, impostor_mm=None):
        self.flight, self.off_mm, self.attest, self.impostor_mm = flight, off_mm, attest, impostor_mm
        self.start_ms = NOW_MS
        self.now_ms = lambda: NOW_MS

    def _message(self, t_ms, off_mm):
        here = self.flight.claim(t_ms)
        return BroadcastClaim(
            lat_e7=here.lat_e7,
            lon_e7=here.lon_e7 + round(off_mm / MM_PER_LON_E7),
            t_ms=t_ms + 50,
            said_ms=t_ms,
            accuracy_mm=1_000,
        )

    def _all(self, off_mm):
        return [self._message(t_ms, off_mm) for t_ms in range(self.start_ms, self.now_ms(), 200)]

    def heard(self, since_ms):
        messages = self._all(self.off_mm)
        if self.impostor_mm is not None:
            messages += self._all(self.impostor_mm)
        return tuple(sorted((one for one in messages if one.t_ms >= since_ms), key=lambda one: one.t_ms))

    def sent(self, since_ms):
        if not self.attest:
            return ()
        return [from_base64url(digest_of(one)) for one in self._all(self.off_mm) if one.t_ms >= since_ms]


def told(make_duo, make_flight, **more):
    flight = make_flight()
    broadcasts = Told(flight, **more)
    duo = make_duo(flight=flight, heard=broadcasts.heard, sent=broadcasts.sent)
    broadcasts.now_ms = lambda: duo.now_ms
    duo.run()
    return duo


def test_an_honest_drones_broadcasts_are_attributed(make_duo, make_flight):
    duo = told(make_duo, make_flight)
    assert duo.verdict.outcome == "verified"
    assert duo.verdict.broadcast.outcome == "supported"
    assert duo.verdict.broadcast.attributed == len(duo.evidence.attested) > 1
    assert duo.failures() == []


def test_beside_an_impostor_it_lands(make_duo, make_flight):
    duo = told(make_duo, make_flight, impostor_mm=36_000)
    assert (duo.verdict.outcome, duo.verdict.permission) == ("verified", "granted")
    assert (duo.verdict.broadcast.outcome, duo.verdict.broadcast.supported) == ("contradicted", True)


def test_a_drone_that_attests_a_lie_is_refuted(make_duo, make_flight):
    duo = told(make_duo, make_flight, off_mm=36_000)
    assert (duo.verdict.outcome, duo.verdict.broadcast.outcome) == ("refuted", "own_contradicted")
    assert len(duo.evidence.ranges.t_ms) == 160, "the pad waited for a broadcast that the measurement supports"


def test_a_drone_that_attests_nothing_is_no_worse_off_than_its_broadcasts(make_duo, make_flight):
    assert told(make_duo, make_flight, attest=False).verdict.outcome == "verified"
    lying = told(make_duo, make_flight, attest=False, off_mm=36_000)
    assert (lying.verdict.outcome, lying.verdict.permission) == ("inconclusive", "refused")
    assert lying.evidence.attested == ()


def test_a_long_session_attests_its_newest_positions(make_duo, make_flight):
    flight = make_flight()
    digests = [number.to_bytes(8, "big") for number in range(100)]
    duo = make_duo(flight=flight, sent=lambda since_ms: digests)
    duo.run()
    assert duo.verdict.outcome == "verified"
    assert duo.evidence.attested == tuple(to_base64url(digest) for digest in digests[-MAX_ATTESTED:])


def test_a_pad_that_changes_the_list_has_no_signature_for_it(make_duo, make_flight):
    duo = make_duo(sent=lambda since_ms: [b"12345678"])
    decide = duo._decide
    duo._decide = lambda evidence: decide(dataclasses.replace(evidence, attested=(to_base64url(b"87654321"),)))
    duo.run()
    assert "countersignature_invalid" in [reason.code for reason in duo.verdict.reasons]
    assert duo.verdict.permission == "refused"


def test_a_second_list_ends_the_session(make_duo):
    duo = make_duo(sent=lambda since_ms: [b"12345678"])
    attest = duo.uav._words.attest

    def twice(digests, now_ms):
        attest(digests, now_ms)
        attest(digests, now_ms)

    duo.uav._words.attest = twice
    duo.run()
    assert duo.evidence.failure == "out_of_turn"
    assert duo.verdict.permission == "refused"


def test_the_list_has_a_message_type_of_its_own():
    assert len({kind.value for kind in MessageType}) == len(MessageType) == 11


# --- whole proofs over the radio, with a ledger -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("own_mm", "impostor_mm", "attests", "outcome", "finding"),
    [
        (0, None, True, "verified", "supported"),
        (0, 36_000, True, "verified", "contradicted"),
        (0, 36_000, False, "verified", "contradicted"),
        (36_000, None, True, "refuted", "own_contradicted"),
        (36_000, None, False, "inconclusive", "contradicted"),
    ],
)
async def test_a_whole_proof_with_a_remote_id_module(world, own_mm, impostor_mm, attests, outcome, finding):
    def said(off_mm):
        here = world.flight.claim(world.clock())
        location = Location(
            lat_e7=here.lat_e7,
            lon_e7=here.lon_e7 + round(off_mm / MM_PER_LON_E7),
            altitude_mm=here.height_mm,
            horizontal_accuracy=HorizontalAccuracy.M_1,
            after_hour_ms=world.clock() % HOUR_MS // 100 * 100,
        )
        return encode(Pack(messages=(BasicId(uas_id="uav-1", id_type=IdType.SERIAL_NUMBER), location)))

    async def broadcast(pad_address, module_address):
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as drone,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody,
        ):
            while True:
                message = said(own_mm)
                drone.sendto(message, pad_address)
                drone.sendto(message, module_address)
                if impostor_mm is not None:
                    for _ in range(5):
                        somebody.sendto(said(impostor_mm), pad_address)
                await asyncio.sleep(0.2)

    async with RemoteIdModule(("127.0.0.1", 0), "uav-1", world.clock) as module:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            pad_address = probe.getsockname()
        listen = "{}:{}".format(*pad_address)
        more = {"broadcasts": module} if attests else {}
        async with world.pad(remote_id={"listen": listen}), world.uav(**more) as uav:
            sending = asyncio.create_task(broadcast(pad_address, module.address))
            await asyncio.sleep(0.5)
            result = await uav.prove("pad-1", "land")
            sending.cancel()
    assert result.verdict.broadcast is not None
    assert (result.verdict.outcome, result.verdict.broadcast.outcome) == (outcome, finding)
    assert bool(result.verdict.broadcast.attributed) == attests
    assert bool(world.acted) == (outcome == "verified")
