"""Lines of a process's log: in UTC, and nothing that somebody else wrote begins a line of its own."""

from __future__ import annotations

import logging
import sys
import time
from typing import Final

_ESCAPED: Final = {code: f"\\x{code:02x}" for code in (*range(0x20), 0x7F, *range(0x80, 0xA0))} | {
    0x0A: "\\n",
    0x0D: "\\r",
    0x2028: "\\u2028",
    0x2029: "\\u2029",
}
"""Control characters, and what some programs take for the end of a line."""


class LogLines(logging.Formatter):
    """``2026-01-01T12:00:00.123Z WARNING logger: text``; a traceback follows, indented."""

    converter = staticmethod(time.gmtime)
    default_time_format = "%Y-%m-%dT%H:%M:%S"
    default_msec_format = "%s.%03dZ"

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - as logging calls it
        """The line itself."""
        return super().formatMessage(record).translate(_ESCAPED)

    def format(self, record: logging.LogRecord) -> str:
        """The line and its traceback, if it has one."""
        return "\n    ".join(super().format(record).splitlines())


def set_up_log(level: int | str) -> None:
    """Log lines to standard error, so that standard output has the ready line alone."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(LogLines())
    logging.basicConfig(level=level, handlers=[handler], force=True)
