"""What the core raises: one tree, so that a boundary catches one type."""

from __future__ import annotations


class ProofError(Exception):
    """Base of everything that the core raises."""


class EncodingError(ProofError):
    """Bytes or a value that canonical JSON does not allow."""


class RecordError(ProofError):
    """A record with an unknown or missing field, a wrong type or a value out of range.

    ``path`` names the field, for example ``claim.lat_e7``; it is empty for the record itself.
    """

    def __init__(self, path: str, message: str) -> None:
        super().__init__(f"{path or 'record'}: {message}")
        self.path = path
        self.message = message


class KeyAgreementError(ProofError):
    """A public key that is no point of P-256, or an exchange that yields no key."""


class GeometryError(ProofError):
    """A position outside of what a pad's local frame can express."""
