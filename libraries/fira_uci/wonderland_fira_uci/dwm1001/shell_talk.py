"""Shell mode: the board streams lines by itself.

``lec`` and its like *toggle* the stream, and so does an empty line, which repeats the last command. So the host listens
first whether a stream runs already; and a board that fell silent is reset, because only then its state is known.
"""

from __future__ import annotations

from enum import Enum

from wonderland_fira_uci.dwm1001 import shell
from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError
from wonderland_fira_uci.dwm1001.talk import Output, Timings


class _State(Enum):
    LISTENING = 1
    ENTERING = 2
    STREAMING = 3
    RESETTING = 4


class ShellTalk:
    """Brings the board to stream ``command`` (``les``, ``lec`` or ``lep``) and reads the lines."""

    def __init__(self, output: Output, timings: Timings, command: str = "les") -> None:
        self._output = output
        self._timings = timings
        self._command = command.encode("ascii") + b"\r"
        self._lines = shell.LineReader()
        self._state = _State.LISTENING
        self._silence_ms = timings.silence_ms
        self.due_ms: int | None = None

    @property
    def octets_dropped(self) -> int:
        """Octets of lines that were too long or never ended."""
        return self._lines.octets_dropped

    def begin(self, now_ms: int) -> None:
        """The port is open."""
        self._lines.reset()
        self._silence_ms = self._timings.silence_ms
        self._go(_State.LISTENING, now_ms, self._timings.listen_ms)

    def stop(self) -> None:
        """The port is gone."""
        self._lines.reset()
        self.due_ms = None

    def receive(self, data: bytes, now_ms: int) -> None:
        """Octets from the board."""
        for line in self._lines.feed(data):
            self._line(line, now_ms)
        if self._state is _State.ENTERING and self._lines.pending.endswith((shell.PROMPT, shell.PROMPT + b" ")):
            self._output.data += self._command
            self._go(_State.STREAMING, now_ms, self._silence_ms)

    def due(self, now_ms: int) -> None:
        """Nothing came for as long as the state allows."""
        if self._state in {_State.LISTENING, _State.RESETTING}:
            self._enter(now_ms)
        elif self._state is _State.ENTERING:
            self._output.lose("the board shows no shell prompt; is it a DWM1001 with PANS, at 115200 baud?")
            self._enter(now_ms)
        else:
            self._output.lose(
                f"no line for {self._silence_ms / 1000:g} s: no anchor in reach, or no tag; the board is being reset"
            )
            self._silence_ms = min(2 * self._silence_ms, self._timings.silence_max_ms)
            self._output.data += b"\rreset\r"
            self._lines.reset()
            self._go(_State.RESETTING, now_ms, self._timings.boot_ms)

    def _enter(self, now_ms: int) -> None:
        self._lines.reset()
        self._output.data += shell.ENTER_SHELL
        self._go(_State.ENTERING, now_ms, self._timings.prompt_ms)

    def _line(self, line: str, now_ms: int) -> None:
        try:
            report = shell.parse_line(line)
        except Dwm1001DecodeError:
            if self._state is _State.STREAMING:  # before, it is the answer of the generic mode, or a greeting
                self._output.reports_bad += 1
            return
        if report is None or self._state is _State.RESETTING:
            return
        self._silence_ms = self._timings.silence_ms
        self._go(_State.STREAMING, now_ms, self._silence_ms)
        self._output.alive()
        self._output.report(report)

    def _go(self, state: _State, now_ms: int, wait_ms: int) -> None:
        self._state = state
        self.due_ms = now_ms + wait_ms
