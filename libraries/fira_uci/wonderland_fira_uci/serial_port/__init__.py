"""A byte pipe to a serial device that may vanish and return: ``ReconnectingPort`` over pyserial."""

from wonderland_fira_uci.serial_port.devices import (
    BAUD_RATE,
    ByteDevice,
    Opener,
    PortError,
    serial_opener,
    url_problem,
)
from wonderland_fira_uci.serial_port.port import PortObserver, PortTimings, ReconnectingPort

__all__ = [
    "BAUD_RATE",
    "ByteDevice",
    "Opener",
    "PortError",
    "PortObserver",
    "PortTimings",
    "ReconnectingPort",
    "serial_opener",
    "url_problem",
]
