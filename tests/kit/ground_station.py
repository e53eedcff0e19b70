"""A ground station's end of a MAVLink connection, by pymavlink's parser: what came, commands and parameters."""

from __future__ import annotations

import asyncio
import contextlib
import struct
import time
from collections import defaultdict

from pymavlink.dialects.v20 import ardupilotmega as dialect

COMMAND_S = 3.0
TRIES = 5


class GroundStation:
    """`async with GroundStation.by_tcp(port)` or `.by_udp(port, of_autopilot)`: both ends on loopback.

    `heard` is called with each message as it comes; `latest` has the last of each name, `texts` what was said.
    """

    def __init__(self, opened, system=255):
        self._opened = opened
        self._mav = dialect.MAVLink(None, srcSystem=system, srcComponent=190)
        self._reader = dialect.MAVLink(None)
        self._reader.robust_parsing = True
        self._waiting = defaultdict(list)
        self.latest = {}
        self.arrived = defaultdict(list)
        self.texts = []
        self.heard = []
        self.target = 1

    @classmethod
    def by_tcp(cls, port, **more):
        return cls(lambda station: _Tcp(station, port), **more)

    @classmethod
    def by_udp(cls, port, of_autopilot, **more):
        return cls(lambda station: _Udp(station, port, of_autopilot), **more)

    async def __aenter__(self):
        self._link = self._opened(self)
        await self._link.open()
        self._beating = asyncio.create_task(self._beat())
        return self

    async def __aexit__(self, *_):
        self._beating.cancel()
        await asyncio.gather(self._beating, return_exceptions=True)
        await self._link.close()

    async def _beat(self):
        while True:
            self.send(
                dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
            )
            await asyncio.sleep(1)

    def send(self, message):
        self._mav.seq = (self._mav.seq + 1) % 256
        self.write(bytes(message.pack(self._mav)))

    def write(self, data):
        """Bytes of another sender on this link."""
        self._link.write(data)

    def take(self, data):
        now = time.monotonic()
        for message in self._reader.parse_buffer(data) or []:
            name = message.get_type()
            if message.get_srcSystem() != self.target or name == "BAD_DATA":
                continue
            self.latest[name] = message
            self.arrived[name].append(now)
            if name == "STATUSTEXT":
                self.texts.append(message.text)
            for call in self.heard:
                call(message)
            for future in self._waiting.pop(name, []):
                if not future.done():
                    future.set_result(message)

    async def next(self, name, timeout_s=30.0, where=lambda _: True):
        """The next message of that name for which `where` holds."""
        async with asyncio.timeout(timeout_s):
            while True:
                future = asyncio.get_running_loop().create_future()
                self._waiting[name].append(future)
                message = await future
                if where(message):
                    return message

    async def command(self, number, *values, component=1):
        """Its result, asked again while none comes."""
        values = (*values, *[0.0] * (7 - len(values)))
        for attempt in range(TRIES):
            answer = asyncio.create_task(self.next("COMMAND_ACK", COMMAND_S, lambda ack: ack.command == number))
            await asyncio.sleep(0)
            self.send(dialect.MAVLink_command_long_message(self.target, component, number, attempt, *values))
            with contextlib.suppress(TimeoutError):
                return (await answer).result
        raise TimeoutError(f"no COMMAND_ACK for {number}")

    async def done(self, number, *values):
        """As `command`, which has to be accepted."""
        result = await self.command(number, *values)
        assert result == dialect.MAV_RESULT_ACCEPTED, f"command {number}: result {result}; {self.texts[-3:]}"

    async def every(self, message_id, interval_ms):
        await self.done(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_ms * 1_000)

    async def set(self, name, value, *, kind=dialect.MAV_PARAM_TYPE_REAL32):
        """A parameter; `kind` for PX4, which sends integers as the bytes of a float."""
        raw = (
            float(value) if kind == dialect.MAV_PARAM_TYPE_REAL32 else struct.unpack("<f", struct.pack("<i", value))[0]
        )
        for _ in range(TRIES):
            answer = asyncio.create_task(self.next("PARAM_VALUE", COMMAND_S, lambda param: param.param_id == name))
            await asyncio.sleep(0)
            self.send(dialect.MAVLink_param_set_message(self.target, 1, name.encode(), raw, kind))
            with contextlib.suppress(TimeoutError):
                return (await answer).param_value
        raise TimeoutError(f"no PARAM_VALUE of {name}")

    def set_quickly(self, name, value):
        """A parameter, unacknowledged: where it is set again and again."""
        self.send(
            dialect.MAVLink_param_set_message(self.target, 1, name.encode(), value, dialect.MAV_PARAM_TYPE_REAL32)
        )


class _Tcp:
    def __init__(self, station, port):
        self._station, self._port = station, port

    async def open(self):
        async with asyncio.timeout(30):
            while True:
                try:
                    self._reader, self._writer = await asyncio.open_connection("127.0.0.1", self._port)
                except OSError:
                    await asyncio.sleep(0.1)
                else:
                    break
        self._reading = asyncio.create_task(self._read())

    async def _read(self):
        while data := await self._reader.read(4096):
            self._station.take(data)

    def write(self, data):
        self._writer.write(data)

    async def close(self):
        self._reading.cancel()
        await asyncio.gather(self._reading, return_exceptions=True)
        self._writer.close()
        with contextlib.suppress(ConnectionError):
            await self._writer.wait_closed()


class _Udp(asyncio.DatagramProtocol):
    def __init__(self, station, port, of_autopilot):
        self._station, self._port, self._of_autopilot = station, port, of_autopilot

    async def open(self):
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", self._port))

    def datagram_received(self, data, addr):
        self._station.take(data)

    def error_received(self, exc):
        """The autopilot is not up yet."""

    def write(self, data):
        self._transport.sendto(data, ("127.0.0.1", self._of_autopilot))

    async def close(self):
        self._transport.close()
