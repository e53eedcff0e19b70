"""Logs for people (one line of text) or for machines (one JSON object per line), on standard error."""

from __future__ import annotations

import datetime as dt
import json
import logging
import sys
from typing import Final

TEXT_FORMAT: Final = "%(asctime)s %(levelname)s %(name)s: %(message)s"
_EXTRA: Final = ("tx_id", "reference")


class JsonLines(logging.Formatter):
    """One record as one line of JSON: time (RFC 3339, UTC), level, logger, message, and what was added to it."""

    def format(self, record: logging.LogRecord) -> str:
        """The line, without its end."""
        document: dict[str, object] = {
            "time": dt.datetime.fromtimestamp(record.created, dt.UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        document.update({name: getattr(record, name) for name in _EXTRA if hasattr(record, name)})
        if record.exc_info:
            document["exception"] = self.formatException(record.exc_info)
        return json.dumps(document, ensure_ascii=False)


def set_up(style: str, level: str) -> None:
    """Log to standard error as ``text`` or ``json``, from ``level`` on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines() if style == "json" else logging.Formatter(TEXT_FORMAT))
    logging.basicConfig(handlers=[handler], level=level.upper(), force=True)
