"""Every error that ``wonderland_fabric_gateway`` raises on purpose; catch `LedgerError` to catch them all.

The Gateway's own tree (endorsement, submission, commit) is in `wonderland_fabric_gateway.gateway.errors`, the CA's in
`wonderland_fabric_gateway.ca.errors`; both descend from `LedgerError` too.
"""

from __future__ import annotations


class LedgerError(Exception):
    """Base of everything this package raises on purpose."""


class IdentityError(LedgerError):
    """A certificate, a serialised identity or its attributes cannot be used; the text says which part and why."""


class SignatureError(LedgerError):
    """A key cannot sign for Fabric, or a signature is malformed, high-S, or not made by that key over that message."""


class BlockError(LedgerError):
    """A block's bytes are not a block of Fabric, or contradict its header."""


class ConnectionFileError(LedgerError):
    """connection.json, or a file it names, is missing or wrong; the text names the field."""


class CheckpointError(LedgerError):
    """A checkpoint cannot be read or written. It is never silently restarted: that would replay or skip events."""


class FileWriteError(LedgerError):
    """A file could not be written durably (no space, no permission, a failing disk); what stood there still does."""


class RevocationListError(LedgerError):
    """A revocation list that must not get onto the channel: foreign, wrongly signed, or without its issuer's key id."""


class VerificationError(LedgerError):
    """A block or a transaction is not what the channel's own configuration asks for; the text says what is wrong."""


class AddressError(LedgerError):
    """A text that is no HOST:PORT."""


class ContractFailedError(LedgerError):
    """The contract answered with an error. `status` is an HTTP-like number from 400 to 599."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status
