"""The audit log: who did or read what, in rows that nobody can change, chained and anchored on the ledger."""

from wonderland_backend.audit.store import record, record_read

__all__ = ["record", "record_read"]
