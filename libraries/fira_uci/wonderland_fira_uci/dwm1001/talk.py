"""What the two ways of talking to a board share: timings, events, and where their output gathers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from wonderland_fira_uci.dwm1001.reports import Generation, LocationReport, Report, Version


@dataclass(frozen=True, slots=True, kw_only=True)
class Timings:
    """Milliseconds. ``poll_ms``: between two questions. ``answer_ms``: longest wait for an answer.

    ``misses``: answers that may be missing in a row. ``retry_ms``: pause before a board that does not answer is asked
    again. ``listen_ms``: how long to listen for a stream that runs already. ``prompt_ms``: longest wait for the shell's
    prompt. ``silence_ms``: without a line for so long the board is reset, the next time after twice as long, at most
    ``silence_max_ms``. ``boot_ms``: how long a reset takes.
    """

    poll_ms: int = 100
    answer_ms: int = 250
    misses: int = 3
    retry_ms: int = 1_000
    listen_ms: int = 400
    prompt_ms: int = 1_500
    silence_ms: int = 5_000
    silence_max_ms: int = 60_000
    boot_ms: int = 1_500


@dataclass(frozen=True, slots=True)
class BoardReady:
    """The board reports. Version and generation are known in TLV mode, where the board tells them."""

    version: Version | None
    generation: Generation | None


@dataclass(frozen=True, slots=True)
class BoardLost:
    """The board does not report; it is being tried again. The text says why and what to look at."""

    detail: str


@dataclass(frozen=True, slots=True)
class Reported:
    """Something that the board measured or heard."""

    report: Report


BoardEvent = BoardReady | BoardLost | Reported


class Output:
    """Octets for the board and events for the host, as they gather."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.events: list[BoardEvent] = []
        self.is_ready = False
        self.reports = 0
        self.reports_bad = 0
        """Answers and lines that made no sense, or of which only parts were whole."""
        self._lost = ""

    def report(self, report: Report) -> None:
        """Pass a report on."""
        self.reports += 1
        if isinstance(report, LocationReport) and report.damaged:
            self.reports_bad += 1
        self.events.append(Reported(report))

    def alive(self, version: Version | None = None, generation: Generation | None = None) -> None:
        """The board answers as it should; said once."""
        if not self.is_ready:
            self.is_ready, self._lost = True, ""
            self.events.append(BoardReady(version, generation))

    def lose(self, detail: str) -> None:
        """The board is not, or no longer, reporting; said once for each reason."""
        self.is_ready = False
        if detail != self._lost:
            self._lost = detail
            self.events.append(BoardLost(detail))


class Talk(Protocol):
    """One way of talking to a board that is connected."""

    due_ms: int | None
    """When ``due`` wants to be called; None while stopped."""

    @property
    def octets_dropped(self) -> int:
        """Octets that belonged to no answer and no line."""
        ...

    def begin(self, now_ms: int) -> None:
        """The port is open."""

    def stop(self) -> None:
        """The port is gone."""

    def receive(self, data: bytes, now_ms: int) -> None:
        """Octets from the board."""

    def due(self, now_ms: int) -> None:
        """Do what waited for ``due_ms``: repeat, give up, or ask again."""
