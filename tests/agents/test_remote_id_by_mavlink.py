"""The autopilot's link says what is broadcast, and is told what to broadcast: OPEN_DRONE_ID_*, and who lies about it."""

from __future__ import annotations

import asyncio
import math
import time

import pytest
from kit.fake_autopilot import LAT, LON, FakeAutopilot, OverUdp

from wonderland.attested import attested_position
from wonderland.clock import SteadyClock
from wonderland.toml_settings import SettingsError
from wonderland_remote_id import Location, decode
from wonderland_remote_id.framings.mavlink import parse_datagram
from wonderland_uav_agent.broadcasts import BroadcastError, OpenDroneIdSettings
from wonderland_uav_agent.broadcasts.autopilot import UNSURE_MS, AutopilotBroadcasts
from wonderland_uav_agent.broadcasts.telling import Telling
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress
from wonderland_uav_agent.position.mavlink.messages import Sender
from wonderland_uav_agent.position.mavlink.wire import Wire
from wonderland_uav_agent.settings import load
from wonderland_uav_agent.sources import open_broadcasts, tell_autopilot

NOW = 1_800_000_000_000
FOLLOWED = Sender(1, 1)
LONG_S = 20.0


class Heard:
    """A link on which an autopilot and others speak, without sockets; `now` is the drone's clock."""

    def __init__(self):
        self.now = NOW
        self.wire = Wire()
        self.drones = {}
        self.source = AutopilotBroadcasts("uav-1", lambda: self.now)

    def drone(self, component):
        """Each component numbers its own messages."""
        return self.drones.setdefault(component, FakeAutopilot())

    def says(self, packet, peer=None, followed=FOLLOWED):
        for message, sender in self.wire.read(packet, peer):
            self.source.hear(message, sender, followed, self.now)

    def location(self, *, component=1, behind_ms=100, **more):
        packet = self.drone(component).location(self.now - behind_ms, component=component, **more)
        self.says(packet)
        return packet

    def named(self, serial, component):
        self.says(self.drone(component).basic_id(serial, component=component))

    def count(self):
        return len(self.source.sent(0))


@pytest.fixture
def heard():
    return Heard()


def of_the_air(packet, heard_ms):
    """What a pad makes of what a transmitter makes of that packet."""
    (framed,) = parse_datagram(packet)
    location = decode(framed.frame)
    assert isinstance(location, Location)
    return attested_position(location, heard_ms)[1]


@pytest.mark.parametrize("component", [1, 236, 237, 238])
def test_what_the_autopilot_or_its_transmitter_states_is_signed_for(heard, component):
    packets = []
    for _ in range(5):
        packets.append(heard.location(component=component))
        heard.named("uav-1", component)
        heard.now += 1_000
    assert heard.source.sent(0) == tuple(of_the_air(packet, heard.now) for packet in packets)
    assert len(heard.source.sent(heard.now - 2_500)) == 2


def test_a_transmitter_that_repeats_what_the_autopilot_states_is_believed(heard, caplog):
    for _ in range(5):
        heard.location(component=1)
        heard.now += 300
        heard.location(behind_ms=400, component=236)
        heard.now += 700
    assert heard.count() == 5
    assert not caplog.records


@pytest.mark.parametrize(("first", "second"), [(1, 236), (236, 1), (236, 237)])
def test_two_that_disagree_end_the_signing_for_both(heard, caplog, first, second):
    heard.location(component=first)
    heard.now += 500
    heard.location(component=second, lat=LAT + 900)
    heard.now += 500
    heard.location(component=first)
    assert heard.count() == 0, "nor for what was heard before"
    assert "no broadcast is signed for" in caplog.text
    heard.now += UNSURE_MS + 1
    heard.location(component=first)
    assert heard.count() == 1, "it lasts no longer than the odd one goes on"


def test_one_that_states_two_places_for_one_moment_is_two(heard):
    heard.location()
    heard.location(lat=LAT + 900)
    assert heard.count() == 0


def test_a_forger_in_a_transmitters_name_is_noticed_by_his_numbers(heard, caplog):
    forger = FakeAutopilot()
    forger._mav.seq = 120
    for _ in range(4):
        heard.location(component=236)
        heard.now += 500
        heard.says(forger.location(heard.now - 100, component=236))
        heard.now += 500
    assert heard.count() == 0
    assert "two speak as component 236" in caplog.text


@pytest.mark.parametrize(
    ("system", "component", "peer"),
    [(7, 1, None), (7, 236, None), (1, 190, None), (1, 191, None), (1, 236, ("127.0.0.1", 9)), (255, 190, None)],
)
def test_nobody_else_speaks_for_it_or_silences_it(heard, caplog, system, component, peer):
    other = FakeAutopilot(system=system)
    for _ in range(3):
        heard.says(other.location(heard.now - 100, component=component, lat=LAT + 900), peer)
        heard.says(other.basic_id("uav-9", component=component), peer)
    packet = heard.location()
    assert heard.source.sent(0) == (of_the_air(packet, heard.now),)
    assert heard.source.strangers == 6
    assert [record.getMessage() for record in caplog.records] == [
        f"system {system}, component {component} speaks of Remote ID, and is no transmitter of the autopilot’s: left out"
    ]


def test_before_an_autopilot_is_followed_nobody_is_believed_or_a_stranger(heard):
    heard.says(FakeAutopilot().location(NOW - 100), followed=None)
    assert (heard.count(), heard.source.strangers) == (0, 0)


def test_what_another_autopilot_stated_is_not_this_ones(heard):
    heard.location()
    assert heard.count() == 1
    heard.now += 500
    heard.says(FakeAutopilot(system=3).location(heard.now - 100, lat=LAT + 900), followed=Sender(3, 1))
    assert heard.count() == 1, "of the new one alone, and the old one is no second voice"


@pytest.mark.parametrize("component", [1, 236])
def test_another_serial_number_is_refused_by_name(heard, caplog, component):
    heard.location()
    heard.named("1581F5FKD229400A1234", component)
    heard.now += 500
    heard.location()
    assert heard.count() == 0
    assert "serial number 1581F5FKD229400A1234, and this drone’s certificate says uav-1" in caplog.text
    heard.now += UNSURE_MS + 1
    heard.named("uav-1", component)
    heard.location()
    assert heard.count() == 1


@pytest.mark.parametrize(
    "wrong",
    [
        {"seconds": math.nan},
        {"seconds": math.inf},
        {"seconds": -5.0},
        {"seconds": 3_700.0},
        {"lat": 910_000_000},
        {"horizontal_accuracy": 200},
    ],
)
def test_values_that_no_field_can_have_are_counted_and_left_out(heard, wrong):
    heard.location(**wrong)
    heard.now += 1_000
    heard.location()
    assert (heard.source.bad, heard.count()) == (1, 1)


@pytest.mark.parametrize("behind_ms", [1_900, -900, 18_000, -18_000])
def test_what_another_clock_dated_is_not_signed_for(heard, caplog, behind_ms):
    heard.location(behind_ms=behind_ms)
    assert (heard.source.undated, heard.count()) == (1, 0)
    assert f"dated {-behind_ms / 1e3:+.1f} s" in caplog.text


def test_a_position_that_is_older_than_the_last_one_is_left_out(heard, caplog):
    heard.location(behind_ms=100)
    heard.location(behind_ms=900, lat=LAT + 900)
    assert (heard.source.backwards, heard.count()) == (1, 1)
    assert "older than its last one" in caplog.text


def test_a_flood_costs_no_memory_and_pushes_nothing_out(heard, caplog):
    first = heard.location()
    for number in range(2_000):
        heard.location(seconds=number % 3_600 + 0.5)
        heard.says(FakeAutopilot(system=9).basic_id(f"uav-{number + 2}", component=190))
    assert heard.source.sent(0) == (of_the_air(first, heard.now),)
    for number in range(2_000):
        heard.named(f"uav-{number + 2}", 236)
    assert heard.count() == 0
    assert len(caplog.records) < 100


# --- over sockets -------------------------------------------------------------------------------------------------


async def until(condition, what):
    async with asyncio.timeout(LONG_S):
        while not condition():
            await asyncio.sleep(0.01)
    assert condition(), what


async def test_it_comes_by_the_link_of_the_position():
    drone, clock = FakeAutopilot(), SteadyClock()
    async with (
        MavlinkPosition(UdpAddress("127.0.0.1", 0), clock) as source,
        open_broadcasts("mavlink", "uav-1", clock, source) as heard,
        OverUdp(drone, source.address) as link,
    ):
        await source.wait(LONG_S)
        async with OverUdp(FakeAutopilot(beats=False), source.address) as forger:
            forger.transport.sendto(forger.autopilot.location(clock(), component=236, lat=LAT + 900))
            await until(lambda: heard.strangers == 1, "of another address")
        packet = drone.location(clock(), component=236)
        link.transport.sendto(packet)
        await until(lambda: heard.sent(0), "it is heard")
        assert heard.sent(0) == (of_the_air(packet, clock()),)


@pytest.mark.parametrize("signs", [True, False])
async def test_on_a_signed_link_only_what_is_signed_is_believed(signs):
    drone, clock = FakeAutopilot(), SteadyClock()
    signing = drone._mav.signing
    signing.secret_key, signing.link_id, signing.sign_outgoing = bytes(range(32)), 3, True
    signing.timestamp = 100 * (clock() - 1_420_070_400_000)
    drone.rates = {33: 0.1, 24: 0.2, 2: 1.0}
    async with (
        MavlinkPosition(UdpAddress("127.0.0.1", 0), clock, key=signing.secret_key) as source,
        open_broadcasts("mavlink", "uav-1", clock, source) as heard,
        OverUdp(drone, source.address) as link,
    ):
        await source.wait(LONG_S)
        signing.sign_outgoing = signs
        link.transport.sendto(drone.location(clock()))
        signing.sign_outgoing = True
        link.transport.sendto(drone.basic_id("uav-1"))
        await until(lambda: heard.packets >= 1 + signs, "the second one is heard")
        assert len(heard.sent(0)) == signs


async def test_without_an_autopilots_link_there_is_none_to_listen_to():
    for text, said in (("mavlink", "only with --position mavlink"), ("bluetooth", "give mavlink or udp:HOST:PORT")):
        with pytest.raises(BroadcastError, match=said):
            async with open_broadcasts(text, "uav-1", SteadyClock(), object()):
                pass
    with pytest.raises(BroadcastError, match=r"\[open_drone_id\]: only with"):
        tell_autopilot(OpenDroneIdSettings(), "uav-1", object())


# --- what the autopilot is told -----------------------------------------------------------------------------------

WHOLE = OpenDroneIdSettings(operator_id="FIN87astrdge12k8-xyz", category="open", class_eu=2, description="Harbour")
TOLD = {f"OPEN_DRONE_ID_{name}" for name in ("BASIC_ID", "OPERATOR_ID", "SELF_ID", "SYSTEM")}


async def test_the_autopilot_is_told_who_it_is_whose_it_is_and_where_it_took_off():
    drone, clock = FakeAutopilot(), SteadyClock()

    def systems():
        return [message for message in drone.told if message.get_type() == "OPEN_DRONE_ID_SYSTEM"]

    async with MavlinkPosition(UdpAddress("127.0.0.1", 0), clock) as source:
        tell_autopilot(WHOLE, "1581F5FKD229400A1234", source)
        async with OverUdp(drone, source.address):
            began = time.monotonic()
            await until(lambda: {message.get_type() for message in drone.told} >= TOLD, "all are told")
            drone.armed = True
            await asyncio.sleep(0.5)
            drone.lat = LAT + 5_000
            before = len(systems())
            await until(lambda: len(systems()) >= before + 2, "it is told again")
            assert len(systems()) <= time.monotonic() - began + 2, "once a second"
    ends = {(m.get_srcSystem(), m.get_srcComponent(), m.target_system, m.target_component) for m in drone.told}
    assert ends == {(1, 191, 1, 1)}
    said = {message.get_type().removeprefix("OPEN_DRONE_ID_"): message for message in drone.told}
    assert bytes(said["BASIC_ID"].uas_id).rstrip(b"\0") == b"1581F5FKD229400A1234"
    assert (said["BASIC_ID"].id_type, said["BASIC_ID"].ua_type) == (1, 2)
    assert said["OPERATOR_ID"].operator_id.rstrip("\0") == "FIN87astrdge12k8", "without its secret"
    assert said["SELF_ID"].description.rstrip("\0") == "Harbour"
    system = said["SYSTEM"]
    assert {(m.operator_latitude, m.operator_longitude) for m in systems()} == {(LAT, LON)}, "where it took off"
    assert system.operator_altitude_geo == pytest.approx(31.4, abs=0.5)
    assert (system.operator_location_type, system.classification_type) == (0, 1)
    assert (system.category_eu, system.class_eu) == (1, 3)
    assert abs(system.timestamp + 1_546_300_800 - time.time()) < 3


async def test_one_that_flies_when_the_agent_begins_is_told_no_place_that_nobody_knows(caplog):
    drone, clock = FakeAutopilot(armed=True), SteadyClock()
    async with MavlinkPosition(UdpAddress("127.0.0.1", 0), clock) as source:
        tell_autopilot(OpenDroneIdSettings(), "uav-1", source)
        async with OverUdp(drone, source.address):
            await source.wait(LONG_S)
            await until(lambda: len(drone.told) >= 2, "its number is told, and again")
    assert {message.get_type() for message in drone.told} == {"OPEN_DRONE_ID_BASIC_ID"}
    assert "OPEN_DRONE_ID_SYSTEM is not told" in caplog.text


@pytest.mark.parametrize("uav_id", ["a-drone-with-far-too-long-an-id", "drön-1"])
def test_an_id_that_is_no_serial_number_is_said_at_the_start(uav_id):
    with pytest.raises(BroadcastError, match=f"{uav_id} cannot be broadcast as a serial number"):
        Telling(OpenDroneIdSettings(), uav_id, followed=lambda: None, claim=lambda _: None)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('operator_id = "FIN87astrdge12k9-xyz"', "check character"),
        (f'operator_id = "{"x" * 21}"', "operator_id"),
        ('operator_id = "Jäätelö"', "operator_id"),
        ("class_eu = 2", "give the category"),
        ('class_eu = 7\ncategory = "open"', "class_eu"),
        ('aircraft = "kite"', "aircraft"),
        ("operator = { lat = 91.0, lon = 0.0, height_m = 0.0 }", "lat"),
        ('operater_id = "x"', "operater_id"),
    ],
)
def test_settings_that_are_wrong_are_named(tmp_path, table, said):
    file = tmp_path / "uav.toml"
    file.write_text(f"[open_drone_id]\n{table}\n")
    with pytest.raises(SettingsError, match=said):
        load(file)
