"""A virtual DWM1001 tag: PANS R2 or LEAPS, generic mode and shell, with the manners and faults of real boards."""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from wonderland_fira_uci.dwm1001 import tlv
from wonderland_fira_uci.dwm1001.reports import (
    AnchorDistance,
    BoardPosition,
    Configuration,
    Generation,
    LocationReport,
    Version,
)
from wonderland_simulator.dwm1001_node import lines
from wonderland_simulator.uci_node.air import Measure

FIRMWARE: Final = Version((1, 3, 0, 1), 0x00010700, 0xDECA002A)
GREETING: Final = b"\r\n\r\n DWM1001 TWR Real Time Location System\r\n\r\n Help      :  ? or help\r\n\r\ndwm> "
ENTER_WITHIN_S: Final = 1.0
MAX_COMMAND_OCTETS: Final = 80
MAX_ANCHORS: Final = 4
"""PANS ranges with up to four anchors in a round."""
_MODES: Final = {"nmt": "tn", "nmi": "ain", "nma": "an"}
BOOT_S: Final = 0.05
"""Real boards take a second; nobody gains from waiting here."""


@dataclass(frozen=True, slots=True)
class VirtualAnchor:
    """An anchor of the tag's network: its address, its name for ``measure``, where the network believes it to be."""

    address: int
    name: str
    position: BoardPosition


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """Manners and faults. ``update_ms``: a new round every so often.

    ``splice``: share of lines that are cut midway and go on with an anchor. ``nan``: share of rounds without an own
    position. ``poor``: share of distances that are 2 m too long and that the board itself rates at 20 %. ``garbage``:
    share of lines or answers before which noise comes. ``busy``: share of questions answered by status 4.
    """

    update_ms: int = 100
    splice: float = 0.0
    nan: float = 0.0
    poor: float = 0.0
    garbage: float = 0.0
    busy: float = 0.0


class VirtualDwm1001:
    """One tag; a ``PortDevice``. ``measure(name, anchor name, t_s)`` is asked once for each anchor and round.

    ``solve``: the board's own estimate from its distances, None where it has none; it is hearsay for whoever reads it.
    """

    def __init__(
        self,
        name: str,
        anchors: Sequence[VirtualAnchor],
        measure: Measure,
        *,
        rng: random.Random,
        generation: Generation = Generation.PANS_R2,
        quirks: Quirks | None = None,
        solve: Callable[[Sequence[AnchorDistance]], BoardPosition | None] | None = None,
        clock_s: Callable[[], float] = time.monotonic,
        address: int = 0x1A2B,
    ) -> None:
        self.name = name
        self.address = address
        """The low 16 bits of its own number."""
        self.generation = generation
        self.quirks = quirks or Quirks()
        self.mode = "tn"
        """tn: a tag; ain: the initiating anchor; an: an anchor."""
        self.network = 0
        self.rates_tenths = (1, 1)
        """As ``aurs`` sets them, kept over restarts like mode and network; ``quirks.update_ms`` is what it does."""
        self.rounds = 0
        self.in_shell = False
        self.streaming = ""
        """Which of les, lec and lep runs; empty while none does."""
        self.transmit: Callable[[bytes], None] = _nowhere
        self._anchors = tuple(anchors)
        self._measure = measure
        self._rng = rng
        self._solve = solve
        self._clock_s = clock_s
        self._report = LocationReport(())
        self._received = bytearray()
        self._last_command = ""
        self._return_s = -ENTER_WITHIN_S
        self._timer: asyncio.TimerHandle | None = None

    @property
    def desynchronised(self) -> bool:
        """Whether it holds a TLV frame's beginning and waits for the rest."""
        return bool(self._received) and not self.in_shell

    def resynchronise(self) -> None:
        """The line was quiet: what waits is no frame."""
        if self.desynchronised:
            self._received.clear()
            self.transmit(tlv.encode_status(1))

    def power_on(self) -> None:
        """Boot: generic mode, no stream."""
        self.in_shell, self.streaming, self._last_command = False, "", ""
        self._received.clear()
        self._report = LocationReport(())
        self._next_round()

    def power_off(self) -> None:
        """Say nothing more until it is switched on again."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def receive(self, data: bytes) -> None:
        """Octets of the host."""
        for octet in data:
            if self.in_shell:
                self._typed(octet)
            else:
                self._generic(octet)

    # --- rounds --------------------------------------------------------------------------------------------------

    def _next_round(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(self.quirks.update_ms / 1000, self._round)

    def _round(self) -> None:
        self._next_round()
        t_s = self._clock_s()
        distances: list[AnchorDistance] = []
        for anchor in self._anchors if self.mode == "tn" else ():
            measured = self._measure(self.name, anchor.name, t_s)
            if measured.range_mm is not None and len(distances) < MAX_ANCHORS:
                distances.append(self._distance(anchor, measured.range_mm))
        own = None
        if self._solve is not None and len(distances) >= 3 and self._rng.random() >= self.quirks.nan:
            own = self._solve(distances)
        self._report = LocationReport(tuple(distances), own, int(t_s * 1e6) & 0xFFFFFFFF, moving=True)
        self.rounds += 1
        if self.streaming:
            self._stream()

    def _distance(self, anchor: VirtualAnchor, range_mm: int) -> AnchorDistance:
        if self._rng.random() < self.quirks.poor:
            return AnchorDistance(anchor.address, range_mm + 2_000, 20, anchor.position)
        return AnchorDistance(anchor.address, range_mm, 100, anchor.position)

    def _stream(self) -> None:
        line = lines.WRITERS[self.streaming](self._report)
        if not line:
            return
        if self._rng.random() < self.quirks.splice:
            line = lines.spliced(line, self._rng)
        self._noise()
        self.transmit(line.encode("ascii") + b"\r\n")

    def _noise(self) -> None:
        if self._rng.random() < self.quirks.garbage:
            self.transmit(self._rng.randbytes(self._rng.randrange(1, 12)))

    # --- generic mode --------------------------------------------------------------------------------------------

    def _generic(self, octet: int) -> None:
        if octet == 0x0D and bytes(self._received) in {b"", b"\r"}:
            now_s = self._clock_s()
            if now_s - self._return_s < ENTER_WITHIN_S:
                self._return_s = -ENTER_WITHIN_S
                self._received.clear()
                self.in_shell = True
                self.transmit(GREETING)
                return
            self._return_s = now_s
        self._received.append(octet)
        if len(self._received) >= 2 and len(self._received) == 2 + self._received[1]:
            frame = tlv.Tlv(self._received[0], bytes(self._received[2:]))
            self._received.clear()
            self._noise()
            self.transmit(self._answer(frame))

    def _answer(self, frame: tlv.Tlv) -> bytes:
        if frame.type == tlv.VER_GET and not frame.value:
            return tlv.encode_version(FIRMWARE)
        if frame.type == tlv.CFG_GET and not frame.value:
            return tlv.encode_configuration(Configuration(is_anchor=self.mode != "tn"))
        if frame.type != tlv.LOC_GET:
            return tlv.encode_status(1)
        if frame.value != tlv.location_request(self.generation).value:
            return tlv.encode_status(3 if self.generation is Generation.LEAPS else 1)
        if self._rng.random() < self.quirks.busy:
            return tlv.encode_status(4)
        return tlv.encode_location(self._report, self.generation)

    # --- shell ---------------------------------------------------------------------------------------------------

    def _typed(self, octet: int) -> None:
        if octet != 0x0D:
            if len(self._received) < MAX_COMMAND_OCTETS:
                self._received.append(octet)
            self.transmit(bytes((octet,)))
            return
        command = self._received.decode("ascii", "replace").strip() or self._last_command
        self._received.clear()
        self.transmit(b"\r\n")
        self._last_command = command
        if command in lines.WRITERS:
            self.streaming = "" if self.streaming == command else command
        elif command == "quit":
            self.in_shell, self.streaming = False, ""
            return
        elif command == "reset":
            self._reboot()
            return
        elif command in _MODES:
            self.mode = _MODES[command]
            self._reboot()
            return
        elif command.split()[:1] in (["si"], ["nis"], ["aurs"]):
            self.transmit(self._configured(*command.split()))
        elif command:
            self.transmit(b"unknown command\r\n")
        self.transmit(b"dwm> ")

    def _configured(self, command: str, *values: str) -> bytes:
        """The answer to what shows and sets the node's configuration."""
        match command, values:
            case "nis", (text,):
                try:
                    self.network = int(text, 0) & 0xFFFF
                except ValueError:
                    return b"nis: err\r\n"
                return b"nis: ok\r\n"
            case "aurs", (moving, resting) if moving.isdigit() and resting.isdigit():
                self.rates_tenths = (int(moving), int(resting))
                return b"aurs: ok\r\n"
            case "si", ():
                return lines.system_information(self.mode, self.network, self.address, self.rates_tenths)
            case _:
                return f"{command}: err\r\n".encode()

    def _reboot(self) -> None:
        self.power_off()
        self.in_shell, self.streaming, self._last_command = False, "", ""
        self._timer = asyncio.get_running_loop().call_later(BOOT_S, self.power_on)


def _nowhere(data: bytes) -> None:
    """Not connected."""
