"""An autopilot that speaks MAVLink by pymavlink's own messages, over real sockets; it sends what it is asked for.

It says what a test tells it to say: `drone.lat = ...`. Nothing of the product is in it.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as dialect

LAT, LON = 604_518_000, 222_666_000
UNDULATION_MM = 19_400


@dataclass
class FakeAutopilot:
    system: int = 1
    lat: int = LAT
    lon: int = LON
    alt_mm: int = 12_000
    alt_ellipsoid_mm: int | None = None
    fix_type: int = 3
    h_acc: int = 200
    v_acc: int = 400
    boot_offset_ms: int = 30_000
    unix_ahead_ms: int = 0
    refuses: frozenset[int] = frozenset()
    deaf: int = 0
    """How many requests get lost."""
    beats: bool = True
    asked: list[tuple[int, int]] = field(default_factory=list)
    heartbeats_heard: list[tuple[int, int, int]] = field(default_factory=list)
    told: list = field(default_factory=list)
    """What it was told to broadcast."""
    armed: bool = False
    rates: dict[int, float] = field(default_factory=dict)

    def __post_init__(self):
        self._started = time.monotonic()
        self._mav = dialect.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self._reader = dialect.MAVLink(None)
        self._reader.robust_parsing = True
        self._sent: dict[int, float] = {}
        self.first_asked = asyncio.Event()

    def pack(self, message, component=1):
        self._mav.srcSystem, self._mav.srcComponent = self.system, component
        self._mav.seq = (self._mav.seq + 1) % 256
        return bytes(message.pack(self._mav))

    def location(self, t_ms, *, component=1, lat=None, horizontal_accuracy=11, seconds=None):
        """OPEN_DRONE_ID_LOCATION, as a transmitter is told."""
        after_hour_s = t_ms % 3_600_000 / 1_000 if seconds is None else seconds
        where = (self.lat if lat is None else lat, self.lon, -1_000.0, 31.4, 0, 12.0)
        more = (horizontal_accuracy, 5, 0, 3, after_hour_s, 10)
        message = dialect.MAVLink_open_drone_id_location_message(0, 0, [0] * 20, 2, 36_100, 100, 0, *where, *more)
        return self.pack(message, component)

    def basic_id(self, serial, *, component=1):
        text = serial.encode().ljust(20, b"\0")
        return self.pack(dialect.MAVLink_open_drone_id_basic_id_message(0, 0, [0] * 20, 1, 2, text), component)

    def boot_ms(self):
        return int((time.monotonic() - self._started) * 1000) + self.boot_offset_ms

    def reboot(self):
        """Forgets what it was asked for, as one does."""
        self._started, self.boot_offset_ms = time.monotonic(), 0
        self.rates.clear()
        self._sent.clear()

    def heartbeat(self):
        return self.pack(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 128 * self.armed, 0, 4, 3
            )
        )

    def message(self, number):
        if number == 33:
            return self.pack(
                dialect.MAVLink_global_position_int_message(
                    self.boot_ms(), self.lat, self.lon, self.alt_mm, 5_000, 0, 0, 0, 65_535
                )
            )
        if number == 24:
            above = self.alt_mm + UNDULATION_MM if self.alt_ellipsoid_mm is None else self.alt_ellipsoid_mm
            return self.pack(
                dialect.MAVLink_gps_raw_int_message(
                    0, self.fix_type, self.lat, self.lon, self.alt_mm, 80, 120, 0, 0, 14, above, self.h_acc, self.v_acc
                )
            )
        unix_us = (time.time_ns() // 1_000) + 1_000 * self.unix_ahead_ms
        return self.pack(dialect.MAVLink_system_time_message(unix_us, self.boot_ms()))

    def hear(self, data):
        """What to answer at once."""
        answer = b""
        for message in self._reader.parse_buffer(data) or []:
            if message.get_type().startswith("OPEN_DRONE_ID"):
                self.told.append(message)
            elif message.get_type() == "HEARTBEAT":
                self.heartbeats_heard.append((message.get_srcSystem(), message.get_srcComponent(), message.type))
            elif (
                message.get_type() == "COMMAND_LONG" and message.command == 511 and message.target_system == self.system
            ):
                number, interval_us = int(message.param1), int(message.param2)
                self.asked.append((number, interval_us))
                self.first_asked.set()
                if len(self.asked) <= self.deaf:
                    continue
                refused = number in self.refuses
                if not refused:
                    self.rates[number] = interval_us / 1e6
                answer += self.pack(dialect.MAVLink_command_ack_message(511, 2 if refused else 0))
        return answer

    async def speak(self, send):
        """Until cancelled; without end it says it is alive, and what it was asked for."""
        next_beat = 0.0
        nan = float("nan")
        while True:
            now = time.monotonic()
            if self.beats and now >= next_beat:
                next_beat = now + 0.2
                send(self.heartbeat())
                send(self.pack(dialect.MAVLink_attitude_message(self.boot_ms(), nan, nan, nan, nan, nan, nan)))
            for number, interval in list(self.rates.items()):
                if now >= self._sent.get(number, 0.0) + min(interval, 0.1):
                    self._sent[number] = now
                    send(self.message(number))
            await asyncio.sleep(0.02)


class OverUdp(asyncio.DatagramProtocol):
    """`async with OverUdp(autopilot, address)`: it sends to a companion computer that listens."""

    def __init__(self, autopilot, address):
        self.autopilot, self._address = autopilot, address

    async def __aenter__(self):
        loop = asyncio.get_running_loop()
        self.transport, _ = await loop.create_datagram_endpoint(lambda: self, remote_addr=self._address)
        self._speaking = asyncio.create_task(self.autopilot.speak(self.transport.sendto))
        return self

    async def __aexit__(self, *_):
        self._speaking.cancel()
        await asyncio.gather(self._speaking, return_exceptions=True)
        self.transport.close()

    def datagram_received(self, data, addr):
        answer = self.autopilot.hear(data)
        if answer:
            self.transport.sendto(answer)


class OverTcp:
    """`async with OverTcp(autopilot)`: it waits for a client, as ArduPilot does on 5760."""

    def __init__(self, autopilot):
        self.autopilot = autopilot
        self.writers = []

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_):
        self._server.close()
        self.hang_up()
        await self._server.wait_closed()

    def hang_up(self):
        for writer in self.writers:
            writer.close()
        self.writers.clear()

    async def _serve(self, reader, writer):
        self.writers.append(writer)
        speaking = asyncio.create_task(self.autopilot.speak(writer.write))
        try:
            while data := await reader.read(4096):
                writer.write(self.autopilot.hear(data))
        except ConnectionError:
            pass
        finally:
            speaking.cancel()
            await asyncio.gather(speaking, return_exceptions=True)
            writer.close()
