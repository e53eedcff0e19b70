"""Serial numbers of unmanned aircraft, ANSI/CTA-2063-A: ``MMMM L S…`` = manufacturer, length code, serial."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from wonderland_remote_id.errors import FieldError

_MANUFACTURER: Final = re.compile(r"[0-9A-HJ-NP-Z]{4}\Z")
_SERIAL: Final = re.compile(r"[0-9A-HJ-NP-Z]+\Z")
_LENGTH: Final = "0123456789ABCDEF"


@dataclass(frozen=True, slots=True)
class SerialNumber:
    """A serial number in its parts: ``manufacturer`` is the four-character code that ICAO assigns."""

    manufacturer: str
    serial: str


def parse_serial_number(text: str) -> SerialNumber:
    """The parts of a serial number. Raises `FieldError` saying which rule of ANSI/CTA-2063-A it breaks."""
    if not _MANUFACTURER.match(text[:4]):
        raise FieldError(
            "serial number",
            "begins with the manufacturer's code: four capitals or digits, without O and I",
        )
    code, serial = text[4:5], text[5:]
    length = _LENGTH.find(code) if code else -1
    if length < 1:
        raise FieldError("serial number", "its fifth character is the length of the rest, 1 to 9 or A to F")
    if len(serial) != length:
        raise FieldError("serial number", f"announces {length} characters after the length code and has {len(serial)}")
    if not _SERIAL.match(serial):
        raise FieldError("serial number", "holds digits and capitals only, without O and I")
    return SerialNumber(text[:4], serial)
