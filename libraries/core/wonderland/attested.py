"""What a drone attests of a message that it broadcasts, and what a pad that hears it makes of the same octets."""

from __future__ import annotations

from typing import Final

from wonderland.proofs.attestation import position_digest
from wonderland_remote_id.messages import Location, resolve_time

MAX_ACCURACY_MM: Final = 10_000_000
"""A claim's accuracy has this bound; the one vaguer class of Remote ID (10 NM) is as good as unknown."""


def stated_accuracy_mm(location: Location) -> int | None:
    """The horizontal accuracy that a message states, 95 %; None where it says nothing of use."""
    accuracy_mm = location.horizontal_accuracy.mm
    return accuracy_mm if accuracy_mm is None or accuracy_mm <= MAX_ACCURACY_MM else None


def attested_position(location: Location, sent_ms: int) -> tuple[int, bytes] | None:
    """The time of a position (Unix ms, to a tenth) and its digest; None where it has no place or no time.

    ``sent_ms``: about when it was sent. A message says only the time after the hour.
    """
    said_ms = resolve_time(location, sent_ms)
    if said_ms is None or said_ms < 0 or location.lat_e7 is None or location.lon_e7 is None:
        return None
    return said_ms, position_digest(location.lat_e7, location.lon_e7, said_ms, stated_accuracy_mm(location))
