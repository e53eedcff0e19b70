"""The DWM1001's shell mode: lines of text that stream after ``les``, ``lec`` or ``lep`` until they are toggled off.

Source: Decawave, *DWM1001 Firmware API Guide* (PANS R2), section "UART shell mode":

* ``les``: ``1151[5.00,8.00,2.25]=6.48 0CA8[0.00,8.00,2.25]=6.51 le_us=2576 est[2.57,1.98,1.68,100]``
* ``lec``: ``DIST,4,AN0,1151,5.00,8.00,2.25,6.44,AN1,…,POS,2.55,2.01,1.71,98``
* ``lep``: ``POS,2.57,2.00,1.67,97``; a passive listener adds whose: ``POS,0,4CAD,2.57,2.00,1.67,97,x08``

At high rates the firmware overwrites what it has not sent yet, so that a line may hold the beginning of one and the end
of another (``AN3,15BA,0.00,0,AN3,15BA,0.00,…``); and it prints ``nan``. Of a damaged line only what is whole is taken:
a group with all its fields, numbers with exactly two decimals, and nothing where the parts disagree. ``lec`` is safer
than ``les``, because it counts its anchors; a splice inside a number that leaves a number nobody can see in either.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError
from wonderland_fira_uci.dwm1001.reports import AnchorDistance, BoardPosition, HeardPosition, LocationReport, Report
from wonderland_fira_uci.dwm1001.tlv import MAX_DISTANCES, MAX_RANGE_MM

ENTER_SHELL: Final = b"\r\r"
PROMPT: Final = b"dwm>"
MAX_LINE_OCTETS: Final = 1024
"""The longest line, 15 anchors in ``les``, has 480."""

_NUMBER: Final = r"-?(?:\d{1,7}\.\d\d|nan)"
_HEX: Final = r"[0-9A-F]{4}"
_COORDINATES: Final = rf"({_NUMBER}),({_NUMBER}),({_NUMBER})"
# What follows must be a boundary: a number that another line cut short would read as a different one.
_LEC_ANCHOR: Final = re.compile(rf"AN\d{{1,2}},({_HEX}),{_COORDINATES},({_NUMBER})(?=,|$)")
_LES_ANCHOR: Final = re.compile(rf"(?<![0-9A-Za-z]){'(' + _HEX + ')'}\[{_COORDINATES}\]=({_NUMBER})(?= |$)")
_LEC_POSITION: Final = re.compile(rf"POS,{_COORDINATES},(\d{{1,3}})(?=,|$)")
_LES_POSITION: Final = re.compile(rf"est\[{_COORDINATES},(\d{{1,3}})\]")
_LISTENER: Final = re.compile(rf"POS,\d{{1,3}},({_HEX}),{_COORDINATES},(\d{{1,3}})(?=,|$)")
_LEC_LINE: Final = re.compile(
    rf"DIST,(\d{{1,2}})(?:,AN\d{{1,2}},{_HEX}(?:,{_NUMBER}){{4}})*(?:,POS(?:,{_NUMBER}){{3}},\d{{1,3}})?"
)
_LES_LINE: Final = re.compile(
    rf"(?:{_HEX}\[{_NUMBER},{_NUMBER},{_NUMBER}\]={_NUMBER} ?)+"
    rf"(?:le_us=\d{{1,9}} ?)?(?:est\[{_NUMBER},{_NUMBER},{_NUMBER},\d{{1,3}}\])?"
)
_COUNT: Final = re.compile(r"DIST,(\d{1,2})(?=,|$)")
_CHATTER: Final = re.compile(r"(?:dwm> ?)*(?:le[scp]|si|quit|reset|\?|\[\d+\.\d+ [A-Z]{3}\].*)?\s*")
"""Prompts, the echo of commands and the firmware's log: nothing that a host needs."""


class LineReader:
    """Cuts a stream of octets into lines. A line that is too long is dropped whole; odd octets become ``?``."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._skipping = False
        self.octets_dropped = 0

    @property
    def pending(self) -> bytes:
        """What came after the last end of a line: the prompt stands there."""
        return bytes(self._buffer)

    def reset(self) -> None:
        """Forget what has come of an unfinished line."""
        self.octets_dropped += len(self._buffer)
        self._buffer.clear()
        self._skipping = False

    def feed(self, data: bytes) -> Iterator[str]:
        """Lines that these octets end, without their ends; empty ones are left out."""
        for part in re.split(rb"([\r\n])", data):
            if part in {b"\r", b"\n"}:
                line, skipping = bytes(self._buffer), self._skipping
                self._buffer.clear()
                self._skipping = False
                if line and not skipping:
                    yield "".join(chr(octet) if 0x20 <= octet < 0x7F else "?" for octet in line)
            elif self._skipping or len(self._buffer) + len(part) > MAX_LINE_OCTETS:
                self.octets_dropped += len(self._buffer) + len(part)
                self._buffer.clear()
                self._skipping = True
            else:
                self._buffer += part


def parse_line(line: str) -> Report | None:
    """What a line reports; None for prompts, echoes and log lines. Raises Dwm1001DecodeError where nothing is whole."""
    text = line.strip()
    while text.startswith("dwm>"):
        text = text[4:].strip()
    if _CHATTER.fullmatch(text):
        return None
    listener = _LISTENER.search(text)
    if listener is not None and "DIST" not in text:
        return HeardPosition(int(listener[1], 16), _position(listener.groups()[1:]))
    if "[" in text and "]=" in text:
        return _les(text)
    if "DIST" in text or "AN" in text:
        return _lec(text)
    own = _LEC_POSITION.search(text) or _LES_POSITION.search(text)
    if own is not None:
        return LocationReport((), _position(own.groups()), damaged=own[0] != text)
    raise Dwm1001DecodeError(f"no line of a DWM1001: {text[:60]!r}")


def _lec(text: str) -> LocationReport:
    whole = _LEC_LINE.fullmatch(text)
    distances, groups = _anchors(_LEC_ANCHOR, text)
    # The count is the first thing of a line; a line that was cut and continued by another does not keep its promise.
    counts = {int(count) for count in _COUNT.findall(text)}
    damaged = whole is None or counts != {groups} or groups != len(distances)
    own = _LEC_POSITION.findall(text)
    position = _position(own[0]) if len(own) == 1 and not damaged else None
    if not distances and position is None and damaged:
        raise Dwm1001DecodeError(f"nothing of the line is whole: {text[:60]!r}")
    return LocationReport(distances, position, damaged=damaged)


def _les(text: str) -> LocationReport:
    distances, groups = _anchors(_LES_ANCHOR, text)
    damaged = _LES_LINE.fullmatch(text) is None or not len(distances) == groups == text.count("]=")
    own = _LES_POSITION.findall(text)
    position = _position(own[0]) if len(own) == 1 and not damaged else None
    if not distances and position is None:
        raise Dwm1001DecodeError(f"nothing of the line is whole: {text[:60]!r}")
    return LocationReport(distances, position, damaged=damaged)


def _anchors(pattern: re.Pattern[str], text: str) -> tuple[tuple[AnchorDistance, ...], int]:
    """The whole groups of a line and how many there are; of an anchor that is there twice with two ranges, none."""
    found: dict[int, AnchorDistance] = {}
    groups = 0
    contradicted: set[int] = set()
    for match in pattern.finditer(text):
        groups += 1
        address = int(match[1], 16)
        where = _position(match.groups()[1:4])
        distance = AnchorDistance(address, _range(match[5]), None, where)
        if found.setdefault(address, distance) != distance:
            contradicted.add(address)
    distances = tuple(found[address] for address in found if address not in contradicted)
    if len(distances) > MAX_DISTANCES:
        raise Dwm1001DecodeError(f"{len(distances)} anchors in one line; a board has at most {MAX_DISTANCES}")
    return distances, groups


def _millimetres(number: str) -> int | None:
    """Exactly, without a float: two decimals are centimetres. None for ``nan``."""
    if number.endswith("nan"):
        return None
    return int(number.replace(".", "")) * 10


def _range(number: str) -> int | None:
    range_mm = _millimetres(number)
    return range_mm if range_mm is not None and 0 < range_mm <= MAX_RANGE_MM else None


def _position(fields: Sequence[str]) -> BoardPosition | None:
    """None where a coordinate is ``nan`` or the quality, if told, is 0 or no percentage."""
    x_mm, y_mm, z_mm = (_millimetres(field) for field in fields[:3])
    quality = int(fields[3]) if len(fields) > 3 else None
    if x_mm is None or y_mm is None or z_mm is None or (quality is not None and not 0 < quality <= 100):
        return None
    return BoardPosition(x_mm, y_mm, z_mm, quality)
