"""A vehicle that a real ArduPilot in simulation flies: started here, led by whoever speaks MAVLink with it.

The world asks it by a link of its own where the simulation has the vehicle, which is where its UWB node is, and leads
its simulated receiver away where the scenario says so. What it tells the vehicle's agent and its pilot is its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import time
from types import TracebackType
from typing import Any, Final, Self

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.pads import Frame
from wonderland_simulator.broadcaster import Fix
from wonderland_simulator.configs import written
from wonderland_simulator.flight import Flight, Vector
from wonderland_simulator.flyer import Flyer
from wonderland_simulator.gnss import PER_95_HORIZONTAL, PER_95_VERTICAL, Gnss
from wonderland_simulator.practice.description import place_of
from wonderland_simulator.practice.reading import VehiclePlan
from wonderland_simulator.practice.tour import attack, spoofing
from wonderland_uav_agent.position.mavlink.wire import dialect

LOG: Final = "autopilot.log"
LIKE_A_COPTER: Final = {
    "FRAME_CLASS": 1.0,
    "SCR_ENABLE": 1.0,
    # Small offsets: else it wants its accelerometers and compasses calibrated before it arms.
    **{f"INS_ACC{number}OFFS_{axis}": 0.001 for number in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{number}SCAL_{axis}": 1.001 for number in ("", "2") for axis in "XYZ"},
    **{
        f"COMPASS_OFS{number}_{axis}": value
        for number in ("", "2", "3")
        for axis, value in zip("XYZ", (5.0, 13.0, -18.0), strict=True)
    },
    "RC7_OPTION": 7.0,
    "LOG_DISARMED": 0.0,
    "LOG_BACKEND_TYPE": 0.0,
    "FS_THR_ENABLE": 0.0,
}
"""Parameters with which a simulated one arms without anybody's calibration; the rest is as ArduPilot has it."""
_BY_THE_RANGES: Final = {"PLND_ENABLED": 1.0, "PLND_TYPE": 1.0}
_ASK_AGAIN_S: Final = 2.0
_LEAD_S: Final = 0.1
_END_S: Final = 3.0
_METRES_PER_DEGREE: Final = 111_320.0
_ARMED: Final = 128


class Piloted(Flyer):
    """One vehicle of the scenario, as its autopilot's simulation has it. Use as an asynchronous context manager."""

    def __init__(self, plan: VehiclePlan, frame: Frame, number: int) -> None:
        """``number``: of the vehicle; its system id follows."""
        assert plan.told.autopilot is not None
        assert plan.program is not None
        assert plan.position is not None
        self._program, self._position, self._wanted = plan.program, plan.position, plan.told.autopilot
        self._directory = plan.files
        self._number = number
        self._link = _Link(self._hear)
        self._process: asyncio.subprocess.Process | None = None
        self._said: list[str] = []
        self._armed: bool | None = None
        self._place: Any = None
        self._receiver: Any = None
        self._led: tuple[float, float] = (0.0, 0.0)
        self._led_s = self._asked_s = self._heard_s = -math.inf
        silent = Gnss(None, 0.0, spoofing=spoofing(plan.told.lies))  # type: ignore[arg-type] # it makes no errors here
        start = Flight(place_of(plan.told.path[0]))
        off_m = plan.told.remote_id.off_m
        super().__init__(plan.told.pad, frame, start, silent, attack=attack(plan.told.lies), broadcast_off_m=off_m)

    @property
    def doing(self) -> str:
        """In a word."""
        if self._armed is None:
            return "no word from its autopilot"
        return "armed" if self._armed else "disarmed"

    @property
    def airborne(self) -> bool:
        """Whether its motors run."""
        return bool(self._armed)

    async def __aenter__(self) -> Self:
        """Starts the program. Raises OSError."""
        self._directory.mkdir(parents=True, exist_ok=True)
        port = await self._link.open()
        lat_e7, lon_e7, height_mm = to_wgs84(self.frame, *(round(value * 1_000) for value in self.flight.position))
        defaults = self._directory / "defaults.parm"
        wanted = {**LIKE_A_COPTER, **_BY_THE_RANGES, **self._wanted.parameters}
        defaults.write_text("".join(f"{name} {value:g}\n" for name, value in wanted.items()))
        await asyncio.sleep(1 - time.time() % 1)  # its UTC begins with a whole second
        with (self._directory / LOG).open("wb") as log:
            self._process = await asyncio.create_subprocess_exec(
                *(str(self._program), "--model", "+", "--speedup", "1", "--wipe", "--defaults", str(defaults)),
                *("--instance", str(self._number), "--sysid", str(self._number + 1)),
                *("--home", f"{lat_e7 / 1e7},{lon_e7 / 1e7},{height_mm / 1e3},0"),
                *("--serial0", f"udpclient:{written(self._wanted.ground_station)}"),
                *("--serial1", f"udpclient:{written(self._position)}", "--serial2", f"udpclient:127.0.0.1:{port}"),
                cwd=self._directory,
                env={"PATH": os.environ.get("PATH", ""), "HOME": str(self._directory), "LC_ALL": "C"},
                stdin=asyncio.subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._link.close()
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            for number in (signal.SIGTERM, signal.SIGKILL):
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, number)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_END_S):
                        await process.wait()
                    break

    def step(self, t_s: float, dt_s: float) -> str:
        """Ask it, lead its receiver away where that is wanted; what it said since the last time."""
        del dt_s
        process = self._process
        if process is not None and process.returncode is not None:
            self._process, self._armed = None, None
            self._said.append(f"has lost its autopilot (code {process.returncode}): {self._directory / LOG}")
        now_s = time.monotonic()
        if now_s - max(self._asked_s, self._heard_s) > _ASK_AGAIN_S:  # what is asked at the very start is forgotten
            self._asked_s = now_s
            self._link.ask_for_places(self._number + 1)
        offset = self.gnss.spoofing.offset(t_s)[:2]
        if offset != self._led and now_s - self._led_s > _LEAD_S and self._place is not None:
            self._led, self._led_s = offset, now_s
            east_m, north_m = offset
            east_degrees = east_m / (_METRES_PER_DEGREE * math.cos(math.radians(self.frame.lat_e7 / 1e7)))
            self._link.set(self._number + 1, "SIM_GPS1_GLTCH_X", north_m / _METRES_PER_DEGREE)
            self._link.set(self._number + 1, "SIM_GPS1_GLTCH_Y", east_degrees)
        said, self._said = self._said, []
        return "; ".join(said)

    def fix(self, t_s: float, t_ms: int) -> Fix | None:  # type: ignore[override] # it says nothing at first
        """Where it says that it is, as its Remote ID module would know it; None before it knows."""
        del t_s
        here, receiver = self._place, self._receiver
        if here is None or receiver is None or receiver.fix_type < 3:
            return None
        try:
            east, north, up = to_local(self.frame, here.lat, here.lon, here.alt)
        except GeometryError:
            return None  # its filter has no place yet, which it says as 0° north, 0° east
        self.claimed_m = (east / 1_000, north / 1_000, up / 1_000)
        return Fix(
            lat_e7=here.lat,
            lon_e7=here.lon,
            height_mm=here.alt,
            above_takeoff_mm=here.relative_alt,
            accuracy_mm=round(receiver.h_acc * PER_95_HORIZONTAL),
            height_accuracy_mm=round(receiver.v_acc * PER_95_VERTICAL),
            speed_mm_s=round(10 * math.hypot(here.vx, here.vy)),
            track_cdeg=round(100 * math.degrees(math.atan2(here.vy, here.vx))) % 36_000,
            vertical_mm_s=-10 * here.vz,
            airborne=self.airborne,
            t_ms=t_ms,
        )

    def _hear(self, message: Any) -> None:
        match message.get_type():
            case "SIM_STATE":
                self._heard_s = time.monotonic()
                with contextlib.suppress(GeometryError, ValueError, OverflowError):  # nowhere near, or no number
                    place = to_local(self.frame, message.lat_int, message.lon_int, round(1_000 * message.alt))
                    self.flight.position = _metres(place)
                    self.flight.velocity = (message.ve, message.vn, -message.vd)
            case "GLOBAL_POSITION_INT":
                self._place = message
            case "GPS_RAW_INT":
                self._receiver = message
            case "HEARTBEAT" if message.get_srcComponent() == 1:
                armed = bool(message.base_mode & _ARMED)
                if armed is not self._armed:
                    self._said.append(self._change(armed=armed))
                self._armed = armed

    def _change(self, *, armed: bool) -> str:
        if armed:
            return "is armed"
        return "is disarmed" if self._armed else "has its autopilot: it can be armed in a minute"


def _metres(place: tuple[int, int, int]) -> Vector:
    east, north, up = place
    return east / 1_000, north / 1_000, up / 1_000


class _Link(asyncio.DatagramProtocol):
    """The world's own: from one program on this machine, which begins."""

    def __init__(self, hear: Any) -> None:
        self._hear = hear
        self._dialect = dialect()
        self._mavlink = self._dialect.MAVLink(None, srcSystem=254, srcComponent=190)
        self._mavlink.robust_parsing = True
        self._transport: asyncio.DatagramTransport | None = None
        self._peer: Any = None

    async def open(self) -> int:
        """The port on which it listens."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", 0))
        return int(self._transport.get_extra_info("sockname")[1])

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        self._peer = self._peer or addr  # the program speaks from one port for all its life
        if addr != self._peer:
            return
        for message in self._mavlink.parse_buffer(data) or []:
            self._hear(message)

    def ask_for_places(self, system: int) -> None:
        """Where the simulation has it, and where it believes to be, ten and twenty times a second."""
        of = self._dialect
        for number, interval_us in (
            (of.MAVLINK_MSG_ID_SIM_STATE, 50_000),
            (of.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 100_000),
            (of.MAVLINK_MSG_ID_GPS_RAW_INT, 200_000),
            (of.MAVLINK_MSG_ID_HEARTBEAT, 1_000_000),
        ):
            values = (number, interval_us, 0, 0, 0, 0, 0)
            self._send(of.MAVLink_command_long_message(system, 1, of.MAV_CMD_SET_MESSAGE_INTERVAL, 0, *values))

    def set(self, system: int, name: str, value: float) -> None:
        """A parameter, unacknowledged: it is set again and again."""
        kind = self._dialect.MAV_PARAM_TYPE_REAL32
        self._send(self._dialect.MAVLink_param_set_message(system, 1, name.encode("ascii"), value, kind))

    def _send(self, message: Any) -> None:
        if self._transport is not None and self._peer is not None:
            self._transport.sendto(message.pack(self._mavlink), self._peer)
            self._mavlink.seq = (self._mavlink.seq + 1) % 256
