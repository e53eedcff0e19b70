"""TLV mode: the host asks for the location, again and again."""

from __future__ import annotations

from typing import Final

from wonderland_fira_uci.dwm1001 import shell, tlv
from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError, Dwm1001StatusError
from wonderland_fira_uci.dwm1001.reports import Generation, LocationReport, Version
from wonderland_fira_uci.dwm1001.talk import Output, Timings

MAX_REFUSALS: Final = 6
"""In a row, then the board counts as lost; it is asked all the same."""
_NOT_THIS_WAY: Final = frozenset({1, 3, 8})
"""Statuses with which a board of the other generation answers."""
_OTHER: Final = {Generation.PANS_R2: Generation.LEAPS, Generation.LEAPS: Generation.PANS_R2}
_SHELL_TEXT: Final = (shell.PROMPT, b"POS,", b"est[", b"le_us=")


class TlvTalk:
    """Asks for the version and the role, then, where that is the right one, for the location at a steady pace.

    An answer that brings nothing new is left out: boards repeat their last round until they have another, and no round
    may count twice. LEAPS' time stamp tells them apart; of PANS, two equal answers are one.
    """

    def __init__(self, output: Output, timings: Timings, *, as_anchor: bool) -> None:
        self._output = output
        self._as_anchor = as_anchor
        self._timings = timings
        self._reader = tlv.AnswerReader()
        self._request = tlv.VER_REQUEST
        self._asked_ms = 0
        self._missed = 0
        self._text = b""
        self._version: Version | None = None
        self._generation = Generation.PANS_R2
        self._refused = 0
        self._before: LocationReport | None = None
        self.due_ms: int | None = None

    @property
    def octets_dropped(self) -> int:
        """Octets that belonged to no answer."""
        return self._reader.octets_dropped

    def begin(self, now_ms: int) -> None:
        """The port is open."""
        self._start_over()
        self._ask(now_ms)

    def stop(self) -> None:
        """The port is gone."""
        self._reader.reset()
        self.due_ms = None

    def receive(self, data: bytes, now_ms: int) -> None:
        """Octets from the board."""
        self._text = (self._text + data)[-64:]
        frames = self._reader.feed(data)
        if frames is None:
            return
        self._missed = 0
        if self._request.type == tlv.VER_GET:
            try:
                self._version = tlv.decode_version(frames)
            except (Dwm1001StatusError, Dwm1001DecodeError):
                self._version = None  # an answer all the same: firmware that tells its version otherwise
            self._request = tlv.CFG_REQUEST
            self._ask(now_ms)
        elif self._request.type == tlv.CFG_GET:
            self._configured(frames, now_ms)
        else:
            self.due_ms = max(now_ms, self._asked_ms + self._timings.poll_ms)
            self._located(frames)

    def due(self, now_ms: int) -> None:
        """An answer did not come, or it is time for the next question."""
        if self._reader.is_waiting:
            self._reader.reset()
            self._missed += 1
            if self._missed >= self._timings.misses:
                self._give_up(now_ms)
                return
        self._ask(now_ms)

    def _configured(self, frames: list[tlv.Tlv], now_ms: int) -> None:
        try:
            problem = tlv.decode_configuration(frames).problem(as_anchor=self._as_anchor)
        except (Dwm1001StatusError, Dwm1001DecodeError):
            problem = ""  # firmware that tells it otherwise: its ranges will show
        if problem:
            self._output.lose(f"{problem}; wonderland uwb prepare puts it right")
            self.due_ms = now_ms + self._timings.retry_ms
        else:
            self._request = tlv.location_request(self._generation)
            self._ask(now_ms)

    def _located(self, frames: list[tlv.Tlv]) -> None:
        try:
            report, generation = tlv.decode_location(frames, self._generation)
        except Dwm1001StatusError as error:
            self._refused += 1
            if self._refused >= MAX_REFUSALS:
                self._output.lose(f"the board does not tell its location ({error}); is it configured as a tag?")
            if error.status in _NOT_THIS_WAY:  # otherwise it is busy, or in trouble that may pass
                self._generation = _OTHER[self._generation]
                self._request = tlv.location_request(self._generation)
            return
        except Dwm1001DecodeError:
            self._output.reports_bad += 1
            return
        self._refused = 0
        self._output.alive(self._version, generation)
        if report != self._before and (report.distances or report.position is not None):
            self._output.report(report)
        self._before = report

    def _give_up(self, now_ms: int) -> None:
        """No answer several times in a row: the board may be another thing, in its shell, or starting."""
        if any(text in self._text for text in _SHELL_TEXT):
            # The first end of line is for the octets of the questions, which the shell took for a command.
            self._output.data += b"\rquit\r"
            self._output.lose("the board is in shell mode; it is being told to leave it")
        else:
            self._output.lose("the board does not answer; is it a DWM1001 with PANS or LEAPS, at 115200 baud?")
        self._start_over()
        self.due_ms = now_ms + self._timings.retry_ms

    def _start_over(self) -> None:
        self._request = tlv.VER_REQUEST
        self._missed = self._refused = 0
        self._text = b""
        self._version = self._before = None
        self._generation = Generation.PANS_R2

    def _ask(self, now_ms: int) -> None:
        self._reader.begin(self._request.type)
        self._output.data += self._request.encode()
        self._asked_ms = now_ms
        self.due_ms = now_ms + self._timings.answer_ms
