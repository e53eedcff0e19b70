"""The pad's durable spool: what the server has not acknowledged yet, prekeys, sessions in progress.

``Spool`` is the asynchronous face; ``SpoolStore`` the synchronous core on SQLite (write-ahead log, FULL).
"""

from wonderland_edge_agent.spool.errors import (
    RecordRefusedError,
    SpoolClosedError,
    SpoolCorruptError,
    SpoolError,
    SpoolFull,
    SpoolLockedError,
)
from wonderland_edge_agent.spool.spool import Spool
from wonderland_edge_agent.spool.store import Entry, SpoolStatus, SpoolStore, StoredRecord

__all__ = [
    "Entry",
    "RecordRefusedError",
    "Spool",
    "SpoolClosedError",
    "SpoolCorruptError",
    "SpoolError",
    "SpoolFull",
    "SpoolLockedError",
    "SpoolStatus",
    "SpoolStore",
    "StoredRecord",
]
