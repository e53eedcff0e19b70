"""What a pad heard of a drone: one broadcast position, attributed to who sent it."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.sessions import BroadcastClaim
from wonderland.telemetry import ReceiverHealth, Track


@dataclass(frozen=True, slots=True)
class Heard:
    """A broadcast position, unverified, and when the pad heard it (Unix ms)."""

    t_ms: int
    track: Track

    def claim(self) -> BroadcastClaim:
        """The record that goes into a session's evidence."""
        said = self.track
        return BroadcastClaim(
            lat_e7=said.lat_e7,
            lon_e7=said.lon_e7,
            t_ms=self.t_ms,
            height_mm=said.height_mm,
            accuracy_mm=said.accuracy_mm,
            transport=said.transport,
            said_ms=said.claim_t_ms if said.claim_t_ms is not None and said.claim_t_ms >= 0 else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverCounts:
    """What became of the frames since the start; each frame is counted once in ``frames`` and at most once beside.

    ``bad``: no frame, or refused by the codec. ``limited``: dropped unread or unattributed because too many came.
    ``unattributed``: positions before (or without) an identity; ``ambiguous``: positions whose source had named
    several drones outside packs. ``duplicates``: positions heard before, by another way or again. ``heard``: positions
    attributed. ``lost`` are frames that never came, by their counters.
    """

    frames: int = 0
    bad: int = 0
    limited: int = 0
    unattributed: int = 0
    ambiguous: int = 0
    heard: int = 0
    duplicates: int = 0
    lost: int = 0
    drones: int = 0

    def health(self) -> ReceiverHealth:
        """The ``receiver`` part of a health record."""
        return ReceiverHealth(frames=self.frames, bad=self.bad)
