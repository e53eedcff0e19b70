"""Which Remote ID messages are the drone's own: it countersigns a digest of each position that it broadcast.

Anybody can broadcast a serial number. What nobody else can make is the drone's signature; so a message that was heard
counts as the drone's only where its digest is in the signed list. The digest covers all that such a message is judged
by: with the accuracy left out, whoever repeats an honest message and states another accuracy would have it convicted.
"""

from __future__ import annotations

from typing import Final

from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import BroadcastClaim

DIGEST_OCTETS: Final = 8
"""A session lasts a minute, and the list is not public until it is over: nobody finds a second message in that time."""


def position_digest(lat_e7: int, lon_e7: int, said_ms: int, accuracy_mm: int | None) -> bytes:
    """Eight octets of SHA-256 over one broadcast position, its own time and the accuracy that it states."""
    said = {"lat_e7": lat_e7, "lon_e7": lon_e7, "said_ms": said_ms}
    if accuracy_mm is not None:
        said["accuracy_mm"] = accuracy_mm
    return encoding.digest(said)[:DIGEST_OCTETS]


def digest_of(heard: BroadcastClaim) -> str | None:
    """The digest of a message that was heard, as evidence lists it; None for one that carries no time."""
    if heard.said_ms is None:
        return None
    return encoding.to_base64url(position_digest(heard.lat_e7, heard.lon_e7, heard.said_ms, heard.accuracy_mm))
