"""The DWM1001's generic mode: type, length, value; little-endian; the host asks, the board answers.

Sources: Decawave, *DWM1001 Firmware API Guide* (PANS R2), "dwm_loc_get", "dwm_ver_get", "dwm_cfg_get"; LEAPS,
*Integration guide*, ``leaps_loc_get``. An answer is ``40 01 status``, followed, when the status is 0, by what was asked
for.

``loc_get`` of PANS R2 has no options: ``0C 00`` → ``41 0D position``, then ``49 len count {distance position}…`` on a
tag, or ``48 len count {distance}…`` (with 64-bit addresses on an anchor). LEAPS takes an option, ``0C 01 opt``, leaves
out what was not asked for and begins each list with a time stamp (u32, µs) and flags. The length, which must fit to
the octet, tells the two apart; where it leaves a doubt (a PANS anchor's list), the way of asking does.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError, Dwm1001EncodeError, Dwm1001StatusError
from wonderland_fira_uci.dwm1001.reports import (
    AnchorDistance,
    BoardPosition,
    Configuration,
    Generation,
    LocationReport,
    Version,
)

VER_GET: Final = 0x15
CFG_GET: Final = 0x08
LOC_GET: Final = 0x0C
STATUS: Final = 0x40
POSITION: Final = 0x41
CONFIGURATION: Final = 0x46
DISTANCES: Final = 0x48
ANCHOR_POSITIONS: Final = 0x49
FIRMWARE_VERSION: Final = 0x50
CONFIGURATION_VERSION: Final = 0x51
HARDWARE_VERSION: Final = 0x52

MAX_VALUE_OCTETS: Final = 255
MAX_DISTANCES: Final = 15
MAX_RANGE_MM: Final = 1_000_000
"""Beyond this a distance is not one: boards send 0xFFFFFFFF or noise for an anchor that they did not hear."""
LEAPS_OPTION_ALL: Final = 3
"""Own position, distances and the anchors' positions."""
MAX_STATUS: Final = 9

_POSITION: Final = struct.Struct("<iiiB")
_DISTANCE: Final = struct.Struct("<HIB")
_LONG_DISTANCE: Final = struct.Struct("<QIB")
_LEAPS_HEAD: Final = struct.Struct("<IBB")
_MOVING: Final = 0x01
_UWB_MODE: Final = 0x03
_ANCHOR: Final = 0x2000


class Tlv(NamedTuple):
    """One type-length-value frame."""

    type: int
    value: bytes

    def encode(self) -> bytes:
        """Two octets and the value. Raises Dwm1001EncodeError."""
        if not 0 <= self.type <= 0xFF or len(self.value) > MAX_VALUE_OCTETS:
            raise Dwm1001EncodeError(f"TLV: type {self.type} with {len(self.value)} octets does not fit")
        return bytes((self.type, len(self.value))) + self.value


VER_REQUEST: Final = Tlv(VER_GET, b"")
CFG_REQUEST: Final = Tlv(CFG_GET, b"")


def location_request(generation: Generation) -> Tlv:
    """``loc_get`` with everything that the generation can tell."""
    return Tlv(LOC_GET, b"" if generation is Generation.PANS_R2 else bytes((LEAPS_OPTION_ALL,)))


def decode_status(frame: Tlv) -> int:
    """The status octet that begins each answer. Raises Dwm1001DecodeError."""
    if frame.type != STATUS or len(frame.value) != 1 or frame.value[0] > MAX_STATUS:
        raise Dwm1001DecodeError(f"an answer begins with 40 01 and a status, not with {frame.encode()[:8].hex(' ')}")
    return frame.value[0]


def decode_location(frames: Sequence[Tlv], asked: Generation = Generation.PANS_R2) -> tuple[LocationReport, Generation]:
    """A whole answer to the ``loc_get`` of the generation ``asked``, and whose layout it has.

    Raises Dwm1001StatusError for a status other than ok, Dwm1001DecodeError for anything that is no such answer.
    """
    body = _ok(frames, "loc_get")
    position: BoardPosition | None = None
    report: LocationReport | None = None
    generation = asked
    for index, frame in enumerate(body):
        if frame.type == POSITION and index == 0:
            if len(frame.value) != _POSITION.size:
                raise Dwm1001DecodeError(f"position: {len(frame.value)} octets where {_POSITION.size} are expected")
            position = _position(frame.value, 0)
        elif frame.type in {DISTANCES, ANCHOR_POSITIONS} and report is None:
            report, generation = _distances(frame, position, asked)
        else:
            raise Dwm1001DecodeError(f"loc_get: type 0x{frame.type:02x} has no place in the answer")
    if report is None:
        raise Dwm1001DecodeError("loc_get: the answer ends before the list of distances")
    return report, generation


def decode_version(frames: Sequence[Tlv]) -> Version:
    """A whole answer to ``ver_get``. Raises Dwm1001StatusError, Dwm1001DecodeError."""
    body = _ok(frames, "ver_get")
    types = [frame.type for frame in body]
    if types != [FIRMWARE_VERSION, CONFIGURATION_VERSION, HARDWARE_VERSION]:
        raise Dwm1001DecodeError(f"ver_get: types {bytes(types).hex(' ')} where 50 51 52 are expected")
    if any(len(frame.value) != 4 for frame in body):
        raise Dwm1001DecodeError("ver_get: each version has four octets")
    variant, patch, minor, major = body[0].value
    return Version(
        (major, minor, patch, variant),
        int.from_bytes(body[1].value, "little"),
        int.from_bytes(body[2].value, "little"),
    )


def decode_configuration(frames: Sequence[Tlv]) -> Configuration:
    """A whole answer to ``cfg_get``. Raises Dwm1001StatusError, Dwm1001DecodeError."""
    body = _ok(frames, "cfg_get")
    if len(body) != 1 or body[0].type != CONFIGURATION or len(body[0].value) != 2:
        raise Dwm1001DecodeError("cfg_get: a configuration of two octets is expected")
    bits = int.from_bytes(body[0].value, "little")
    return Configuration(is_anchor=bool(bits & _ANCHOR), uwb_mode=bits & _UWB_MODE)


def encode_configuration(configuration: Configuration) -> bytes:
    """A whole answer to ``cfg_get`` (the board's side)."""
    bits = configuration.uwb_mode | (_ANCHOR if configuration.is_anchor else 0)
    return encode_status(0) + Tlv(CONFIGURATION, bits.to_bytes(2, "little")).encode()


def encode_status(status: int) -> bytes:
    """The beginning of each answer (the board's side)."""
    return Tlv(STATUS, bytes((status,))).encode()


def encode_version(version: Version) -> bytes:
    """A whole answer to ``ver_get`` (the board's side)."""
    return (
        encode_status(0)
        + Tlv(FIRMWARE_VERSION, bytes(reversed(version.firmware))).encode()
        + Tlv(CONFIGURATION_VERSION, version.configuration.to_bytes(4, "little")).encode()
        + Tlv(HARDWARE_VERSION, version.hardware.to_bytes(4, "little")).encode()
    )


def encode_location(report: LocationReport, generation: Generation, *, with_positions: bool = True) -> bytes:
    """A whole answer to ``loc_get`` (the board's side). Raises Dwm1001EncodeError.

    A distance that is None goes as 0, a missing position as zeros with quality 0, as boards have it.
    """
    rows: list[bytes] = []
    try:
        for distance in report.distances:
            row = _DISTANCE.pack(distance.address, distance.range_mm or 0, distance.quality_percent or 0)
            rows.append(row + (_place(distance.position) if with_positions else b""))
        head = bytes((len(rows),))
        if generation is Generation.LEAPS:
            head = _LEAPS_HEAD.pack(report.device_us or 0, _MOVING if report.moving else 0, len(rows))
        own = _place(report.position)
    except (struct.error, ValueError) as error:
        raise Dwm1001EncodeError(f"loc_get: a value does not fit its field ({error})") from error
    kind = ANCHOR_POSITIONS if with_positions else DISTANCES
    return encode_status(0) + Tlv(POSITION, own).encode() + Tlv(kind, head + b"".join(rows)).encode()


def _place(position: BoardPosition | None) -> bytes:
    if position is None:
        return bytes(_POSITION.size)
    return _POSITION.pack(position.x_mm, position.y_mm, position.z_mm, position.quality_percent or 0)


def _ok(frames: Sequence[Tlv], command: str) -> Sequence[Tlv]:
    if not frames:
        raise Dwm1001DecodeError(f"{command}: an empty answer")
    status = decode_status(frames[0])
    if status:
        raise Dwm1001StatusError(command, status)
    return frames[1:]


def _distances(frame: Tlv, position: BoardPosition | None, asked: Generation) -> tuple[LocationReport, Generation]:
    layouts = (Generation.PANS_R2, Generation.LEAPS)
    for generation in layouts if asked is Generation.PANS_R2 else reversed(layouts):
        parse = _leaps_list if generation is Generation.LEAPS else _pans_list
        report = parse(frame, position)
        if report is not None:
            return report, generation
    raise Dwm1001DecodeError(
        f"distances: {len(frame.value)} octets fit neither PANS' nor LEAPS' list of type 0x{frame.type:02x}"
    )


def _pans_list(frame: Tlv, position: BoardPosition | None) -> LocationReport | None:
    """Count, rows; an anchor writes 64-bit addresses. None where the length does not fit."""
    value, with_positions = frame.value, frame.type == ANCHOR_POSITIONS
    if not value:
        return None
    if len(value) == 1 + value[0] * _row_octets(with_positions=with_positions):
        return LocationReport(_rows(value, 1, value[0], with_positions=with_positions), position)
    if not with_positions and len(value) == 1 + value[0] * _LONG_DISTANCE.size:
        rows = tuple(
            AnchorDistance(address, _range(range_mm), min(quality, 100))
            for address, range_mm, quality in _LONG_DISTANCE.iter_unpack(value[1:])
        )
        return LocationReport(_checked(rows), position)
    return None


def _leaps_list(frame: Tlv, position: BoardPosition | None) -> LocationReport | None:
    """Time stamp, flags, count, rows. None where the length does not fit."""
    value, with_positions = frame.value, frame.type == ANCHOR_POSITIONS
    if len(value) < _LEAPS_HEAD.size:
        return None
    device_us, flags, count = _LEAPS_HEAD.unpack_from(value)
    if len(value) != _LEAPS_HEAD.size + count * _row_octets(with_positions=with_positions):
        return None
    rows = _rows(value, _LEAPS_HEAD.size, count, with_positions=with_positions)
    return LocationReport(rows, position, device_us, bool(flags & _MOVING))


def _row_octets(*, with_positions: bool) -> int:
    return _DISTANCE.size + (_POSITION.size if with_positions else 0)


def _rows(value: bytes, offset: int, count: int, *, with_positions: bool) -> tuple[AnchorDistance, ...]:
    rows: list[AnchorDistance] = []
    for _ in range(count):
        address, range_mm, quality = _DISTANCE.unpack_from(value, offset)
        offset += _DISTANCE.size
        where: BoardPosition | None = None
        if with_positions:
            where = _position(value, offset)
            offset += _POSITION.size
        rows.append(AnchorDistance(address, _range(range_mm), min(quality, 100), where))
    return _checked(tuple(rows))


def _checked(rows: tuple[AnchorDistance, ...]) -> tuple[AnchorDistance, ...]:
    if len(rows) > MAX_DISTANCES:
        raise Dwm1001DecodeError(f"distances: {len(rows)} anchors; a board has at most {MAX_DISTANCES}")
    if len({row.address for row in rows}) != len(rows):
        raise Dwm1001DecodeError("distances: an anchor appears twice")
    return rows


def _range(range_mm: int) -> int | None:
    return range_mm if 0 < range_mm <= MAX_RANGE_MM else None


def _position(value: bytes, offset: int) -> BoardPosition | None:
    """None where the quality says that there is none."""
    position = BoardPosition(*_POSITION.unpack_from(value, offset))
    return position if position.quality_percent else None


class AnswerReader:
    """Gathers the octets of one answer out of whatever the line carries. No I/O, no time.

    ``begin`` says what was asked; ``feed`` returns the answer's frames once they are whole. Octets that belong to no
    answer (the shell's text, the tail of an answer that came too late, noise) are dropped and counted.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._sizes: dict[int, range] = {}
        self._last: frozenset[int] = frozenset()
        self.octets_dropped = 0

    @property
    def is_waiting(self) -> bool:
        """Whether an answer is awaited."""
        return bool(self._last)

    def begin(self, command: int) -> None:
        """Await the answer to this command; what came before it is dropped."""
        self.octets_dropped += len(self._buffer)
        self._buffer.clear()
        self._sizes, self._last = _ANSWERS[command]

    def reset(self) -> None:
        """Await nothing; the answer did not come in time."""
        self.octets_dropped += len(self._buffer)
        self._buffer.clear()
        self._last = frozenset()

    def feed(self, data: bytes) -> list[Tlv] | None:
        """The whole answer, or None while some of it is missing. Without ``begin`` everything is dropped."""
        if not self._last:
            self.octets_dropped += len(data)
            return None
        self._buffer += data
        while self._buffer:
            frames, octets = self._parse()
            if frames is not None:
                del self._buffer[:octets]
                self._last = frozenset()
                return frames
            if octets == 0:
                return None
            self.octets_dropped += octets
            del self._buffer[:octets]
        return None

    def _parse(self) -> tuple[list[Tlv] | None, int]:
        """The answer and its octets; or None and how many octets cannot begin one (0: wait for more)."""
        buffer = self._buffer
        start = buffer.find(_ANSWER_BEGINS[0])
        if start != 0:
            return None, len(buffer) if start < 0 else start
        if not _ANSWER_BEGINS.startswith(buffer[:2]) or (len(buffer) > 2 and buffer[2] > MAX_STATUS):
            return None, 1
        if len(buffer) < 3:
            return None, 0
        frames = [Tlv(STATUS, bytes(buffer[2:3]))]
        offset = 3
        if buffer[2]:
            return frames, offset
        while len(buffer) >= offset + 2:
            kind, size = buffer[offset], buffer[offset + 1]
            if size not in self._sizes.get(kind, ()):
                return None, 1
            if len(buffer) < offset + 2 + size:
                break
            frames.append(Tlv(kind, bytes(buffer[offset + 2 : offset + 2 + size])))
            offset += 2 + size
            if kind in self._last:
                return frames, offset
        return (None, 1) if len(buffer) > offset and buffer[offset] not in self._sizes else (None, 0)


_ANSWER_BEGINS: Final = bytes((STATUS, 1))
_ANSWERS: Final[dict[int, tuple[dict[int, range], frozenset[int]]]] = {
    VER_GET: (
        dict.fromkeys((FIRMWARE_VERSION, CONFIGURATION_VERSION, HARDWARE_VERSION), range(4, 5)),
        frozenset({HARDWARE_VERSION}),
    ),
    CFG_GET: ({CONFIGURATION: range(2, 3)}, frozenset({CONFIGURATION})),
    LOC_GET: (
        {POSITION: range(13, 14), DISTANCES: range(1, 256), ANCHOR_POSITIONS: range(1, 256)},
        frozenset({DISTANCES, ANCHOR_POSITIONS}),
    ),
}
"""For each command the types and lengths that its answer may have, and the types that end it."""
