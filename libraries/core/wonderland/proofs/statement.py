"""What the drone countersigns in step 6: this session, these ranges, these claims and broadcasts of its own.

With the pad's signature on the transaction that carries them, neither can later say that the other invented them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import Claim, RangeTable

PURPOSE: Final = "wonderland/1 countersignature"


def statement(
    session_id: str,
    transcript_sha256: str,
    ranges: RangeTable,
    claims: Sequence[Claim],
    attested: Sequence[str] = (),
) -> bytes:
    """Canonical bytes that are signed with ECDSA P-256 and SHA-256 by the drone's ledger key.

    Times and ranges count, flags about obstructions do not: the drone can not know them. ``attested``: digests of its
    own Remote ID messages (``attestation``); a drone that attests none signs nothing about them.
    """
    table = {
        "t_ms": list(ranges.t_ms),
        "anchors": [{"anchor_id": anchor.anchor_id, "range_mm": list(anchor.range_mm)} for anchor in ranges.anchors],
    }
    said = {
        "purpose": PURPOSE,
        "session_id": session_id,
        "transcript_sha256": transcript_sha256,
        "ranges_sha256": encoding.digest(table).hex(),
        "claims_sha256": encoding.digest([claim.to_json() for claim in claims]).hex(),
    }
    if attested:
        said["broadcast_sha256"] = encoding.digest(list(attested)).hex()
    return encoding.encode(said)
