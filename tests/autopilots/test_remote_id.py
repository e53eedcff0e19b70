"""A real ArduPilot with its Remote ID: it is told what to broadcast, arms by it, and says on its link what it broadcasts."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from kit.ground_station import dialect
from kit.sitl import HEAD_START_S, ArduCopter, own_network

from wonderland_remote_id import BasicId, Location, OperatorId, SelfId, System, decode, resolve_time
from wonderland_remote_id.framings.mavlink import parse_datagram
from wonderland_uav_agent.broadcasts import OpenDroneIdSettings
from wonderland_uav_agent.broadcasts.autopilot import AutopilotBroadcasts
from wonderland_uav_agent.position.mavlink.messages import RemoteIdHeard
from wonderland_uav_agent.sources import open_broadcasts, tell_autopilot

pytestmark = pytest.mark.timeout(180)

SERIAL = "1581F5FKD229400A1234"
OF_THE_COMPANION = 1
PARAMETERS = {"DID_ENABLE": 1, "DID_MAVPORT": OF_THE_COMPANION, "DID_OPTIONS": 1}
TOLD = OpenDroneIdSettings(operator_id="FIN87astrdge12k8-xyz", category="open", class_eu=2, description="Harbour")
GPS_AHEAD_S = 18


@pytest.fixture
def vehicle(tmp_path):
    with own_network(), ArduCopter(tmp_path, parameters=PARAMETERS, head_start_s=HEAD_START_S) as vehicle:
        yield vehicle


class Noting(AutopilotBroadcasts):
    """Keeps the last message of each kind that came, and how far ahead of the clock positions are dated."""

    def __init__(self, *of_every_one):
        super().__init__(*of_every_one)
        self.last, self.ahead_s = {}, []

    def hear(self, message, sender, followed, now_ms):
        super().hear(message, sender, followed, now_ms)
        if isinstance(message, RemoteIdHeard):
            (framed,) = parse_datagram(message.packet)
            decoded = decode(framed.frame)
            self.last[type(decoded)] = decoded
            if isinstance(decoded, Location) and (said_ms := resolve_time(decoded, now_ms)) is not None:
                self.ahead_s.append((said_ms - now_ms) / 1e3)


@contextlib.asynccontextmanager
async def transmitter(source):
    """It only says that it is well, once a second, on the port that the parameters name."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=dialect.MAV_COMP_ID_ODID_TXRX_1)

    async def speak():
        while True:
            message = dialect.MAVLink_open_drone_id_arm_status_message(dialect.MAV_ODID_ARM_STATUS_GOOD_TO_ARM, b"")
            source._link.send(bytes(message.pack(mav)))
            mav.seq = (mav.seq + 1) % 256
            await asyncio.sleep(1)

    speaking = asyncio.create_task(speak())
    try:
        yield
    finally:
        speaking.cancel()
        await asyncio.gather(speaking, return_exceptions=True)


async def test_it_repeats_what_it_is_told_and_arms_by_it(vehicle, companion, monkeypatch):
    monkeypatch.setattr("wonderland_uav_agent.sources.AutopilotBroadcasts", Noting)
    async with vehicle.ground_station() as station:
        await vehicle.in_time(station)
        async with companion() as computer:
            source, clock = computer.source, computer.clock
            async with open_broadcasts("mavlink", SERIAL, clock, source) as heard, transmitter(source):
                await computer.locked()
                await computer.until(lambda: heard.ahead_s, "a position that it broadcasts")
                refused = await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
                assert refused != dialect.MAV_RESULT_ACCEPTED, "nobody told it yet"
                assert any("OpenDroneID" in text for text in station.texts), station.texts
                assert heard.foreign == 0, "no serial number is not another one"

                tell_autopilot(TOLD, SERIAL, source)
                told = {BasicId, OperatorId, SelfId, System}
                await computer.until(
                    lambda: told <= set(heard.last) and heard.last[BasicId].uas_id == SERIAL,
                    "it repeats what it was told",
                )
                await computer.until(lambda: heard.last[System].operator_lat_e7, "and where it takes off")
                assert heard.last[OperatorId].operator_id == "FIN87astrdge12k8"
                assert heard.last[SelfId].text == "Harbour"
                claim = computer.claim()
                assert abs(heard.last[System].operator_lat_e7 - claim.lat_e7) < 50
                assert abs(heard.last[Location].lat_e7 - claim.lat_e7) < 50
                async with asyncio.timeout(30):
                    while await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) != dialect.MAV_RESULT_ACCEPTED:
                        await asyncio.sleep(0.5)

                ahead_s = heard.ahead_s[-1]
                print(f"its positions are dated {ahead_s:+.2f} s; {len(heard.sent(0))} are signed for")
                by_gps_time = abs(ahead_s - GPS_AHEAD_S) < 1.5
                assert by_gps_time or abs(ahead_s) < 1.5
                assert bool(heard.sent(0)) != by_gps_time, "by UTC they are signed for, else refused"
                assert heard.bad == heard.strangers == 0
