"""Recorded UWB ranges with truth as a pad: what would be known of the radios that made them.

The files are read by ``wonderland_edge_agent.commissioning.recording``; the formats are in ``docs/formats.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning
from wonderland_edge_agent.commissioning.errors import RecordingError
from wonderland_edge_agent.commissioning.prior import chip_commissioning
from wonderland_edge_agent.commissioning.recording import RecordedRound
from wonderland_edge_agent.commissioning.recording import Recording as RecordedRanges
from wonderland_edge_agent.geodesy import frame_at
from wonderland_simulator.scenario import DAY_MS, AnchorSite, PadSite

__all__ = ["RecordedRound", "Recording", "RecordingError", "dw1000_commissioning"]

SURVEY_SIGMA_MM: Final = 10


@dataclass(frozen=True)
class Recording(RecordedRanges):
    """All rounds in order of time, and the anchors by name; a pad can be made of it."""

    def pad(self, pad_id: str = "recording") -> PadSite:
        """A pad with these anchors, standing in Turku: the recording has no place on the globe."""
        sites = tuple(
            AnchorSite(name, 0xA000 + index, x, y, z, 0.0)
            for index, (name, (x, y, z)) in enumerate(self.anchors.items())
        )
        return PadSite(pad_id, "Recording", 604_503_100, 222_712_400, 31_000, sites)


def dw1000_commissioning(pad: PadSite, now_ms: int) -> Commissioning:
    """What is known of DW1000 anchors that nobody calibrated: the chip's bias curve and how far units differ."""
    return chip_commissioning(
        frame_at(pad.lat_e7, pad.lon_e7, pad.height_mm),
        (
            Anchor(
                anchor_id=site.anchor_id,
                mac=site.mac,
                east_mm=round(site.east_m * 1000),
                north_mm=round(site.north_m * 1000),
                up_mm=round(site.up_m * 1000),
                survey_sigma_mm=SURVEY_SIGMA_MM,
                bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=0),),
            )
            for site in pad.anchors
        ),
        valid_from_ms=now_ms - DAY_MS,
        valid_until_ms=now_ms + DAY_MS,
    )
