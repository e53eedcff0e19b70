"""The host's side of one DWM1001 as a state machine: octets and time in, octets and events out, no I/O."""

from __future__ import annotations

from enum import Enum
from typing import Final

from wonderland_fira_uci.dwm1001.shell_talk import ShellTalk
from wonderland_fira_uci.dwm1001.talk import BoardEvent, Output, Talk, Timings
from wonderland_fira_uci.dwm1001.tlv_talk import TlvTalk


class Mode(Enum):
    """How to talk to the board.

    TLV is the better one: nothing is spliced, distances come in millimetres and with their quality. SHELL is for boards
    whose shell someone else watches too, and for passive listeners.
    """

    TLV = "tlv"
    LES = "les"
    LEC = "lec"
    LEP = "lep"


class Dwm1001Device:
    """One board. Call ``port_up`` when its port is open; then ``receive_data`` and ``advance``.

    ``as_anchor``: whether it must be an anchor; otherwise it must be a tag. In the shell's modes it may be either.

    Times are milliseconds of any monotonic clock. After each call take ``data_to_send`` and ``events`` and look at
    ``next_timeout_ms``. Whatever the board sends, no call raises.
    """

    def __init__(self, mode: Mode = Mode.TLV, timings: Timings | None = None, *, as_anchor: bool = False) -> None:
        self.mode: Final = mode
        self._output = Output()
        timings = timings or Timings()
        self._talk: Talk = (
            TlvTalk(self._output, timings, as_anchor=as_anchor)
            if mode is Mode.TLV
            else ShellTalk(self._output, timings, mode.value)
        )
        self._is_up = False

    @property
    def is_ready(self) -> bool:
        """Whether the board reports."""
        return self._output.is_ready

    @property
    def reports(self) -> int:
        """How many reports were passed on since the start."""
        return self._output.reports

    @property
    def reports_bad(self) -> int:
        """Answers and lines that made no sense, or of which only parts were whole."""
        return self._output.reports_bad

    @property
    def octets_dropped(self) -> int:
        """Octets that belonged to no answer and no line."""
        return self._talk.octets_dropped

    def port_up(self, now_ms: int) -> None:
        """The port is open: begin."""
        self._is_up = True
        self._talk.begin(now_ms)

    def port_down(self, detail: str) -> None:
        """The port is gone."""
        self._is_up = False
        self._talk.stop()
        self._output.data.clear()
        self._output.lose(detail)

    def receive_data(self, data: bytes, now_ms: int) -> None:
        """Octets from the board."""
        if self._is_up:
            self._talk.receive(data, now_ms)

    def advance(self, now_ms: int) -> None:
        """Do what is due."""
        due_ms = self.next_timeout_ms()
        if due_ms is not None and now_ms >= due_ms:
            self._talk.due(now_ms)

    def next_timeout_ms(self) -> int | None:
        """When ``advance`` has something to do; None without a port."""
        return self._talk.due_ms if self._is_up else None

    def data_to_send(self) -> bytes:
        """What to write to the port now."""
        out = bytes(self._output.data)
        self._output.data.clear()
        return out

    def events(self) -> list[BoardEvent]:
        """What happened since the last call, in order."""
        events, self._output.events = self._output.events, []
        return events
