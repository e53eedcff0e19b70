"""Errors of the embedded ledger. Those below `RequestRefusedError` answer a client; the others stop something."""

from __future__ import annotations

from typing import Final

from wonderland_fabric_gateway.errors import ContractFailedError, LedgerError, RevocationListError

__all__ = [
    "REMEDY",
    "AccessDeniedError",
    "ContractFailedError",
    "ContractLoadError",
    "DirectoryError",
    "EmbeddedLedgerError",
    "LedgerCorruptedError",
    "LedgerLockedError",
    "LedgerOverloadedError",
    "LedgerUnavailableError",
    "MalformedRequestError",
    "ProposalRefusedError",
    "RequestRefusedError",
    "RevocationListError",
    "StorageError",
    "TableCorruptedError",
]


REMEDY: Final = (
    "Restore the ledger's directory from a copy. To see what still holds, read the blocks of a copy of "
    "ledger.sqlite3 (docs: Backup and restore, The embedded ledger)"
)
"""What to do about a row that is not this ledger's."""


class EmbeddedLedgerError(LedgerError):
    """Base of the embedded ledger's own errors."""


class DirectoryError(EmbeddedLedgerError):
    """The ledger's directory cannot be used: missing files, wrong permissions, a foreign database, wrong settings."""


class LedgerLockedError(EmbeddedLedgerError):
    """Another process runs a ledger in this directory."""


class LedgerCorruptedError(EmbeddedLedgerError):
    """The stored chain contradicts itself; the text says where. Nothing is served from it."""


class TableCorruptedError(LedgerCorruptedError):
    """A row is not what follows from the chain: `table` and `key` (its primary key, readable) say which."""

    def __init__(self, text: str, table: str, key: str) -> None:
        super().__init__(text)
        self.table = table
        self.key = key


class StorageError(EmbeddedLedgerError):
    """A block could not be written. `full` says that space is missing, so that trying again later can help."""

    def __init__(self, text: str, *, full: bool) -> None:
        super().__init__(text)
        self.full = full


class LedgerUnavailableError(EmbeddedLedgerError):
    """The ledger takes no transactions now: it is stopping, overloaded, or cannot write. What was committed stays."""


class LedgerOverloadedError(LedgerUnavailableError):
    """Too much is waiting already; what was asked was not begun."""


class ContractLoadError(EmbeddedLedgerError):
    """No contract of that name is installed, or what is installed is none."""


class RequestRefusedError(EmbeddedLedgerError):
    """Base of the answers to a client's request."""


class MalformedRequestError(RequestRefusedError):
    """Bytes that are not the message they should be, or a message without a part that it needs."""


class AccessDeniedError(RequestRefusedError):
    """The sender is nobody the channel knows, no longer anybody, or did not sign this."""


class ProposalRefusedError(RequestRefusedError):
    """A well-formed proposal by a known sender that cannot be accepted: stale, repeated, or for another channel."""
