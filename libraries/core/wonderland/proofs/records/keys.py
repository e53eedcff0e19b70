"""The ledger keys under which records stand: composite keys, designed so that sessions never conflict.

The form is Fabric's own (``shim.CreateCompositeKey``): U+0000, type, U+0000, then each attribute and U+0000.
"""

from __future__ import annotations

from typing import Final

SEPARATOR: Final = "\x00"
LAST: Final = "\U0010ffff"

PAD: Final = "pad"
PREKEY: Final = "prekey"
USED_PREKEY: Final = "used-prekey"
UAV: Final = "uav"
AUTHORISATION: Final = "authorisation"
POLICY: Final = "policy"
CHANGE: Final = "change"
SESSION: Final = "session"
VERDICT: Final = "verdict"
LAST_REQUEST: Final = "last-request"
TESTIMONY: Final = "testimony"
CLOSURES: Final = "closures"
RESERVATIONS: Final = "reservations"
ASSET: Final = "asset"
AUDIT_LOG: Final = "audit-log"
AUDIT_HEAD: Final = "audit-head"


def composite(kind: str, *attributes: str) -> str:
    """The key of a record."""
    return SEPARATOR + SEPARATOR.join((kind, *attributes)) + SEPARATOR


def prefix_range(kind: str, *attributes: str) -> tuple[str, str]:
    """(start, end) of all keys that begin with these attributes; the end is not included."""
    start = composite(kind, *attributes)
    return start, start + LAST


def split(key: str) -> tuple[str, tuple[str, ...]]:
    """(kind, attributes) of a composite key; ("", (key,)) for a plain one."""
    if not key.startswith(SEPARATOR) or not key.endswith(SEPARATOR) or len(key) < 3:
        return "", (key,)
    kind, *attributes = key[1:-1].split(SEPARATOR)
    return kind, tuple(attributes)
