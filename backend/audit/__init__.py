"""The audit log: who did or read what, in rows that nobody can change, chained and anchored on the ledger."""

from backend.audit.chain import record

__all__ = ["record"]
