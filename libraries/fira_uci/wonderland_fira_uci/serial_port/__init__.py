"""A byte pipe to a serial device that may vanish and return: ``ReconnectingPort`` over pyserial, without threads."""

from wonderland_fira_uci.serial_port.port import (
    ByteDevice,
    Opener,
    PortError,
    PortObserver,
    PortTimings,
    ReconnectingPort,
    serial_opener,
)

__all__ = ["ByteDevice", "Opener", "PortError", "PortObserver", "PortTimings", "ReconnectingPort", "serial_opener"]
