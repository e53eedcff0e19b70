"""Real autopilots, simulated: ArduPilot's and PX4's own programs, each in a network that only its test is in.

Both listen on every address of their machine, so a test takes its thread, and with it the autopilot and whatever else
it starts, into a network namespace with loopback alone (`own_network`).
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import fcntl
import math
import os
import signal
import socket
import struct
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from kit.ground_station import GroundStation, dialect
from wonderland_simulator.practice.piloted import LIKE_A_COPTER

ARDUCOPTER, PX4 = "ARDUCOPTER_BIN", "PX4_BUILD_DIR"
COMPANION_PORT = 14_540
"""Where both send to, for a computer on board that listens."""

METRES_PER_DEGREE = 111_320.0
HASTE = 10
"""How fast an ArduPilot with a head start runs; on a busy machine it is slower."""
HEAD_START_S = 47
"""With so much, one that has caught up is ready to be armed."""

_NEW_NETWORK = 0x40000000
_SET_FLAGS, _UP = 0x8914, 1


@dataclass(frozen=True)
class Home:
    """Where the vehicle stands at first; `alt_m` above mean sea level."""

    lat: float = 60.451_800
    lon: float = 22.266_600
    alt_m: float = 12.0


HOME = Home()


@contextlib.contextmanager
def own_network():
    """This thread in a new network namespace, loopback up, and back again. Skips where that is not allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    before = os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
    try:
        if libc.unshare(_NEW_NETWORK):
            pytest.skip("needs a network namespace: run as root, or within `unshare --map-root-user --net`")
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
                fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sh14x", b"lo", _UP))
            yield
        finally:
            assert libc.setns(before, _NEW_NETWORK) == 0, os.strerror(ctypes.get_errno())
    finally:
        os.close(before)


class Vehicle:
    """One process of an autopilot, in a directory of its own; `with` it."""

    name = ""
    kind = 0
    """What its heartbeats name as the autopilot."""

    def __init__(self, directory: Path, home: Home = HOME, parameters: dict[str, float] | None = None):
        self.directory = directory
        self.home = home
        self.parameters = parameters or {}
        self._process: subprocess.Popen[bytes] | None = None

    def command(self) -> list[str]:
        raise NotImplementedError

    def environment(self) -> dict[str, str]:
        return {"PATH": os.environ["PATH"], "HOME": str(self.directory), "LC_ALL": "C"}

    def start(self):
        command = self.command()
        with (self.directory / f"{self.name}.log").open("ab") as log:
            self._process = subprocess.Popen(
                command,
                cwd=self.directory,
                env=self.environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def stop(self):
        """As a battery that is pulled: at once, with all that it started."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait(10)
            self._process = None

    async def restart(self, station):
        """By the battery, or by command where the autopilot obeys that in simulation."""
        self.stop()
        self.start()

    def ended(self) -> bool:
        """Whether it ended by itself."""
        return self._process is not None and self._process.poll() is not None

    def log(self) -> str:
        return (self.directory / f"{self.name}.log").read_text(errors="replace")

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        ended = self.ended()
        self.stop()
        assert not ended, f"{self.name} ended by itself: {self.log()[-3_000:]}"

    def ground_station(self, **more) -> GroundStation:
        raise NotImplementedError

    async def true_place(self, station) -> tuple[float, float, float]:
        """Latitude and longitude in degrees and height above mean sea level in metres, as the simulation has them."""
        raise NotImplementedError


class ArduCopter(Vehicle):
    """ArduPilot. Its first serial port is TCP 5760 (for a companion), its third 5763 (for the ground station); its
    second sends to `COMPANION_PORT`.

    It wants 42 s until its filter uses GPS. With `head_start_s` its clock is behind by so much, and its time goes faster
    until `in_time`: attach a companion after that, and do not restart it (it would begin at that time again).
    """

    name = "arducopter"
    kind = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    tcp_port = 5_760
    defaults = {**LIKE_A_COPTER, "SIM_BARO_RND": 0}  # noqa: RUF012 - read only

    def __init__(self, *of_every_vehicle, head_start_s: int = 0, **more):
        super().__init__(*of_every_vehicle, **more)
        self.head_start_s = head_start_s

    def command(self):
        program = os.environ.get(ARDUCOPTER)
        if not program:
            pytest.skip(f"{ARDUCOPTER} names no program: build ArduPilot's copter for the board sitl")
        parameters = self.directory / "defaults.parm"
        parameters.write_text(
            "".join(f"{name} {value}\n" for name, value in {**self.defaults, **self.parameters}.items())
        )
        home = f"{self.home.lat},{self.home.lon},{self.home.alt_m},0"
        hurried = ["--start-time", str(round(time.time()) - self.head_start_s)] if self.head_start_s else []
        speed = str(HASTE if hurried else 1)
        return [
            *(str(Path(program).resolve()), "--model", "+", "--speedup", speed, "--home", home, *hurried),
            *("--defaults", str(parameters), "--serial0", "tcp:0"),
            *("--serial1", f"udpclient:127.0.0.1:{COMPANION_PORT}", "--serial2", "tcp:3"),
        ]

    def start(self):
        time.sleep(1 - time.time() % 1)  # it counts UTC from a whole second
        super().start()

    async def in_time(self, station):
        """Once it has caught up with the time of day, which goes at its pace from then on."""
        for behind_s, speed in ((3.0, 2), (0.1, 1)):
            async with asyncio.timeout(60):
                while (said := await self._time_of_day(station)) < time.time() - behind_s:
                    assert not self.ended(), self.log()
            assert said < time.time() + 2, "it was attached too late"
            await station.set("SIM_SPEEDUP", speed)

    async def _time_of_day(self, station):
        """Asked for again where it does not come: what is asked at the very start is forgotten at times."""
        while True:
            try:
                return (await station.next("SYSTEM_TIME", 2)).time_unix_usec / 1e6
            except TimeoutError:
                await station.every(dialect.MAVLINK_MSG_ID_SYSTEM_TIME, 100)

    async def restart(self, station):
        await station.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)

    def ground_station(self, **more):
        return GroundStation.by_tcp(5_763, **more)

    async def true_place(self, station):
        if "SIM_STATE" not in station.latest:
            await station.every(dialect.MAVLINK_MSG_ID_SIM_STATE, 50)
        state = await station.next("SIM_STATE")
        return state.lat_int / 1e7, state.lon_int / 1e7, state.alt


class Px4(Vehicle):
    """PX4 with its simulation in the loop of the autopilot's own process (SIH)."""

    name = "px4"
    kind = dialect.MAV_AUTOPILOT_PX4

    def command(self):
        build = os.environ.get(PX4)
        if not build:
            pytest.skip(f"{PX4} names no folder: build PX4's px4_sitl, with bin/px4 and etc in it")
        program, etc = (str(Path(build, part).resolve()) for part in ("bin/px4", "etc"))
        # Its lock and its socket have fixed names in /tmp, so one PX4 at a time has a /tmp: to this one it is its folder.
        alone = 'mount --bind . /tmp && cd /tmp && exec "$@"'
        return ["unshare", "--mount", "sh", "-ec", alone, "px4", program, "-d", "-w", ".", etc]

    def environment(self):
        home = self.home
        return {
            **super().environment(),
            "PX4_SIM_MODEL": "sihsim_quadx",
            "PX4_HOME_LAT": str(home.lat),
            "PX4_HOME_LON": str(home.lon),
            "PX4_HOME_ALT": str(home.alt_m),
            **{f"PX4_PARAM_{name}": str(value) for name, value in self.parameters.items()},
        }

    def ground_station(self, **more):
        return GroundStation.by_udp(14_550, 18_570, **more)

    async def true_place(self, station):
        async with GroundStation.by_udp(19_410, 19_450) as simulation:
            state = await simulation.next("HIL_STATE_QUATERNION")
        return state.lat / 1e7, state.lon / 1e7, state.alt / 1e3


async def drag_gps(station, metres_per_s, for_s, *, heading_deg=0.0, look=None):
    """Let ArduPilot's simulated receiver report places that move away, in real time; what it says of itself stays.

    `look(dragged_m)` is called at each step, ten a second. Its offset stays when this ends.
    """
    began = time.monotonic()
    north, east = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    east_m = METRES_PER_DEGREE * math.cos(math.radians(HOME.lat))
    while (elapsed_s := time.monotonic() - began) < for_s:
        dragged_m = metres_per_s * elapsed_s
        station.set_quickly("SIM_GPS1_GLTCH_X", dragged_m * north / METRES_PER_DEGREE)
        station.set_quickly("SIM_GPS1_GLTCH_Y", dragged_m * east / east_m)
        if look is not None:
            look(dragged_m)
        await asyncio.sleep(0.1)


def metres_between(place, other):
    """(north, east, up) of `other` from `place`: degrees, degrees, metres."""
    north = (other[0] - place[0]) * METRES_PER_DEGREE
    east = (other[1] - place[1]) * METRES_PER_DEGREE * math.cos(math.radians(place[0]))
    return north, east, other[2] - place[2]
