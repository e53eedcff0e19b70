"""Recorded UWB ranges with truth as a pad: what would be known of the radios that made them.

The files are read by ``edge_agent.commissioning.recording``; the formats are in ``docs/formats.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from edge_agent.commissioning.errors import RecordingError
from edge_agent.commissioning.recording import RecordedRound
from edge_agent.commissioning.recording import Recording as RecordedRanges
from edge_agent.geodesy import frame_at
from simulator.scenario import DAY_MS, AnchorSite, PadSite
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning

__all__ = ["RecordedRound", "Recording", "RecordingError", "dw1000_commissioning"]

DW1000_SIGMA_MM: Final = 40
DW1000_BIAS_M: Final = ((0.0, 0.0), (8.0, 0.0), (16.0, 0.08), (30.0, 0.14), (100.0, 0.16))
"""Typical mean error by distance. Installations differ from it by several centimetres, hence the next two."""
DW1000_BIAS_SIGMA_MM: Final = 45
DW1000_INSTALLATION_MM: Final = 60


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
    return Commissioning(
        frame=frame_at(pad.lat_e7, pad.lon_e7, pad.height_mm),
        anchors=tuple(
            Anchor(
                anchor_id=site.anchor_id,
                mac=site.mac,
                east_mm=round(site.east_m * 1000),
                north_mm=round(site.north_m * 1000),
                up_mm=round(site.up_m * 1000),
                survey_sigma_mm=10,
                bias=tuple(
                    BiasPoint(
                        range_mm=round(distance * 1000), bias_mm=round(bias * 1000), sigma_mm=DW1000_BIAS_SIGMA_MM
                    )
                    for distance, bias in DW1000_BIAS_M
                ),
            )
            for site in pad.anchors
        ),
        range_sigma_mm=DW1000_SIGMA_MM,
        installation_sigma_mm=DW1000_INSTALLATION_MM,
        max_range_mm=100_000,
        valid_from_ms=now_ms - DAY_MS,
        valid_until_ms=now_ms + DAY_MS,
        method="DW1000 bias curve from published measurements; not calibrated",
    )
