"""The process's log: times in UTC, and no line that somebody else began."""

from __future__ import annotations

import logging
import re
import sys

from wonderland.log_lines import LogLines


def line(text, *facts, error=None):
    return LogLines().format(logging.LogRecord("a.logger", logging.WARNING, "", 0, text, facts, error))


def test_times_are_utc(monkeypatch):
    record = logging.LogRecord("a", logging.INFO, "", 0, "x", (), None)
    record.created, record.msecs = 1_800_000_000.25, 250
    monkeypatch.setenv("TZ", "Europe/Helsinki")
    assert LogLines().format(record) == "2027-01-15T08:00:00.250Z INFO a: x"


def test_what_others_write_stays_in_its_line():
    forged = "x\r\n2027-01-15T08:00:00.250Z ERROR root: all is well\u2028\x1b[2J\x85"
    found = line("refused: %s", forged)
    assert len(found.splitlines()) == 1
    assert found.isprintable()
    assert "ä" in line("%s", "ä")


def test_a_traceback_begins_no_line_either():
    try:
        int("x\n2027-01-15T08:00:00.250Z ERROR root: all is well")
    except ValueError:
        first, *rest = line("failed", error=sys.exc_info()).splitlines()
    assert re.match(r"\d{4}-.*Z WARNING a\.logger: failed$", first)
    assert len(rest) > 3
    assert all(each.startswith("    ") for each in rest)
