"""Errors of the DWM1001 codecs and of the host's side of the board."""

from __future__ import annotations

from typing import Final

from wonderland_fira_uci.errors import UwbError

STATUS_NAMES: Final = {
    0: "ok",
    1: "unknown command or broken TLV frame",
    2: "internal error",
    3: "invalid parameter",
    4: "busy",
    5: "operation not permitted",
    6: "checksum error",
    7: "input/output error",
    8: "not supported",
    9: "reset required before the command is sent again",
}
"""Status codes of PANS (0 to 5) and of LEAPS (0 to 9)."""


class Dwm1001Error(UwbError):
    """Root of everything that the DWM1001 parts raise."""


class Dwm1001EncodeError(Dwm1001Error):
    """A value that the wire format cannot carry; the text names the field."""


class Dwm1001DecodeError(Dwm1001Error):
    """Bytes or a line from the board that do not follow the format; the text says where and why."""


class Dwm1001StatusError(Dwm1001Error):
    """The board answered a request with a status other than ok; ``status`` is the octet."""

    def __init__(self, command: str, status: int) -> None:
        super().__init__(f"{command} was answered by status {status} ({STATUS_NAMES.get(status, 'unknown')})")
        self.command = command
        self.status = status
