"""A fake autopilot that flies: it obeys commands as ArduPilot or PX4 does, at once and in straight lines."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from kit.fake_autopilot import UNDULATION_MM, FakeAutopilot, dialect
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.pads import Frame

ARDUPILOT, PX4 = 3, 12
MODES = {
    ARDUPILOT: {"auto": 3, "guided": 4, "loiter": 5, "rtl": 6, "land": 9},
    PX4: {"auto": 4 << 16 | 4 << 24, "guided": 4 << 16 | 3 << 24, "loiter": 3 << 16}
    | {"rtl": 4 << 16 | 5 << 24, "land": 4 << 16 | 6 << 24},
}
MM_S = 4_000


@dataclass
class FlyingAutopilot(FakeAutopilot):
    """``place``: where it is in a pad's frame, mm; ``goes``: where to, in ``guided``."""

    frame: Frame | None = None
    stack: int = ARDUPILOT
    place: list[float] = field(default_factory=lambda: [6_000.0, 0.0, 12_000.0])
    goes: list[float] | None = None
    mode: str = "auto"
    armed: bool = True
    on_ground: bool = False
    failsafe: bool = False
    lost: int = 0
    """How many commands get lost on the way."""
    denies: set[int] = field(default_factory=set)
    commands: list[int] = field(default_factory=list)
    arming_answers: list[tuple[int, int]] = field(default_factory=list)
    parameters: dict[str, float] = field(default_factory=dict)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self):
        super().__post_init__()
        self._flown = time.monotonic()
        self._fly()

    def heartbeat(self):
        self._fly()
        base = 128 if self.armed else 0
        state = 5 if self.failsafe else 4
        number = MODES[self.stack][self.mode]
        return self.pack(
            dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_QUADROTOR, self.stack, base | 1, number, state, 3)
        )

    def message(self, number):
        self._fly()
        if number == 245:
            landed = 1 if self.on_ground else 4 if self.mode == "land" else 2
            return self.pack(dialect.MAVLink_extended_sys_state_message(0, landed))
        if number == 33:
            east, north, up = (round(value / 10) for value in self.velocity)
            where = (self.lat, self.lon, self.alt_mm, 5_000)
            return self.pack(
                dialect.MAVLink_global_position_int_message(self.boot_ms(), *where, north, east, -up, 65_535)
            )
        return super().message(number)

    def hear(self, data):
        answer = b""
        kept, self._reader = self._reader, dialect.MAVLink(None)
        self._reader.robust_parsing = True
        for message in self._reader.parse_buffer(bytes(data)) or []:
            kind = message.get_type()
            if kind in {"COMMAND_INT", "COMMAND_LONG"} and message.command != 511:
                answer += self._commanded(message)
            elif kind == "COMMAND_ACK" and message.command == 3001:
                self.arming_answers.append((message.result, message.result_param2))
            elif kind == "PARAM_SET":
                self.parameters[message.param_id] = message.param_value
                answer += self.pack(
                    dialect.MAVLink_param_value_message(message.param_id.encode(), message.param_value, 9, 1, 0)
                )
        self._reader = kept
        return answer + super().hear(data)

    def asks_to_arm(self):
        """PX4's question to the companion computer."""
        return self.pack(dialect.MAVLink_command_long_message(self.system, 191, 3001, 0, 1, 0, 0, 0, 0, 0, 0))

    def _commanded(self, message):
        if self.lost > 0:
            self.lost -= 1
            return b""
        self.commands.append(message.command)
        if message.command in self.denies:
            return self.pack(dialect.MAVLink_command_ack_message(message.command, 2))
        self._fly()
        if message.command == 192:
            alt_mm = round(1_000 * message.z) + UNDULATION_MM
            self.goes = list(to_local(self.frame, message.x, message.y, alt_mm))
            self.mode = "guided"
        elif message.command == 176:
            wanted = round(message.param2) if self.stack == ARDUPILOT else round(message.param2) << 16
            wanted += round(message.param3) << 24
            self.mode = next(name for name, number in MODES[self.stack].items() if number == wanted)
            self.goes = None
        elif message.command in {20, 21}:
            self.mode = {20: "rtl", 21: "land"}[message.command]
        return self.pack(dialect.MAVLink_command_ack_message(message.command, 0))

    def _fly(self):
        now = time.monotonic()
        step, self._flown = now - self._flown, now
        before = list(self.place)
        if self.mode == "guided" and self.goes is not None:
            away = math.dist(self.place, self.goes)
            share = min(1.0, MM_S * step / away) if away else 1.0
            self.place = [here + share * (there - here) for here, there in zip(self.place, self.goes, strict=True)]
        elif self.mode == "land" and not self.on_ground:
            self.place[2] = max(0.0, self.place[2] - MM_S * step)
            self.on_ground = self.place[2] == 0.0
        if step > 0:
            self.velocity = tuple((new - old) / step for new, old in zip(self.place, before, strict=True))
        self.lat, self.lon, height_mm = to_wgs84(self.frame, *(round(value) for value in self.place))
        self.alt_mm = height_mm - UNDULATION_MM
