"""A world that is a recording: each ranging round plays the next recorded one, each position is the recorded truth.

Time stands still between sessions: a round is consumed only when the drone's node leads one. Within a session the
recording runs at the pace of the radio (25 ms a round with four anchors), so a recording at 10 Hz plays at four times
its speed, claims included.
"""

from __future__ import annotations

import asyncio
import random
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.sessions import Claim
from wonderland_fira_uci.uci.config import least_slots
from wonderland_simulator.flight import Vector
from wonderland_simulator.recording import Recording
from wonderland_simulator.scenario import PadSite
from wonderland_simulator.uci_node import Air, Measurement, NodeProfile, PtyPort, VirtualNode
from wonderland_simulator.world import anchor_path, drone_path, plug, send_position

POSITION_S: Final = 0.04
SLOT_S: Final = 0.002
"""Of the plan that boards which say no shortest slot agree on."""
ACCURACY_MM: Final = 50
"""RTK truth, 95 %."""

ClaimError = Callable[[Vector], Vector]
"""Truth → what the drone says, in metres."""


@dataclass
class Window:
    """Recorded time that one session used."""

    first_s: float
    last_s: float


class Playback:
    """The recording as an air and an autopilot; ``run`` until cancelled."""

    def __init__(
        self,
        recording: Recording,
        pad: PadSite,
        uav_id: str,
        directory: Path,
        position_port: int,
        claim: ClaimError,
        *,
        board: NodeProfile | None = None,
    ) -> None:
        """``board``: of all nodes; the pad's own, unless given."""
        profile = board or pad.board
        self._recording = recording
        self._pad = pad
        self._frame = pad.frame
        self._uav_id = uav_id
        self._port = position_port
        self._claim = claim
        self._index = 0
        self._wall_s = 0.0
        self._round_s = least_slots(len(pad.anchors)) * SLOT_S
        self._anchor_of = {f"{pad.pad_id}/{site.anchor_id}": site.anchor_id for site in pad.anchors}
        self._round: float | None = None
        self._air = Air(self._measure, rng=random.Random(1))
        self._serial = [
            PtyPort(VirtualNode(name, self._air, profile=profile), anchor_path(directory, pad.pad_id, anchor_id))
            for name, anchor_id in self._anchor_of.items()
        ]
        drone = VirtualNode(uav_id, self._air, profile=profile)
        self._serial.append(PtyPort(drone, drone_path(directory, uav_id)))
        self.played = 0

    @property
    def position_s(self) -> float:
        """Recorded time that plays now."""
        return self._recording.rounds[min(self._index, len(self._recording.rounds) - 1)].t_s

    @property
    def left(self) -> int:
        """Rounds not yet played."""
        return max(0, len(self._recording.rounds) - 1 - self._index)

    async def run(self) -> None:
        """Play the recording in its own time until cancelled."""
        plug(self._serial)
        out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        out.setblocking(False)
        try:
            while True:
                send_position(out, self._port, self._said(time.time_ns() // 1_000_000))
                await asyncio.sleep(POSITION_S)
        finally:
            out.close()
            self._air.close()
            for port in self._serial:
                port.close()

    def _said(self, t_ms: int) -> Claim:
        """The drone's word: truth at the recorded moment that plays, with the error it was told to make."""
        rounds = self._recording.rounds
        here = rounds[self._index]
        there = rounds[min(self._index + 1, len(rounds) - 1)]
        share = min(1.0, max(0.0, (time.monotonic() - self._wall_s) / self._round_s)) if self._wall_s else 0.0
        x, y, z = (a + (b - a) * share for a, b in zip(here.truth_m, there.truth_m, strict=True))
        lat_e7, lon_e7, height_mm = to_wgs84(self._frame, *(round(value * 1000) for value in self._claim((x, y, z))))
        return Claim(
            lat_e7=lat_e7,
            lon_e7=lon_e7,
            height_mm=height_mm,
            accuracy_mm=ACCURACY_MM,
            height_accuracy_mm=2 * ACCURACY_MM,
            t_ms=t_ms,
        )

    def _measure(self, observer: str, peer: str, t_s: float) -> Measurement:
        if self._uav_id not in {observer, peer}:  # a recording has no ranges between its anchors
            return Measurement(None)
        if observer == self._uav_id and t_s != self._round:  # the drone leads a new round of the ranging session
            self._round = t_s
            self._wall_s = time.monotonic()
            if self._index < len(self._recording.rounds) - 1:
                self._index += 1
                self.played += 1
        anchor_id = self._anchor_of[peer if observer == self._uav_id else observer]
        range_m = self._recording.rounds[self._index].ranges_m.get(anchor_id)
        return Measurement(None if range_m is None else max(0, round(range_m * 1000)))
