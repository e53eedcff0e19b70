"""What a certificate authority refuses, and why."""

from __future__ import annotations

from wonderland_fabric_gateway.errors import LedgerError


class CaError(LedgerError):
    """Base of the CA's errors."""


class CaNotFoundError(CaError):
    """There is no CA in that directory."""


class CaExistsError(CaError):
    """There already is a CA in that directory; making a new one would orphan all that it issued."""


class CaCorruptError(CaError):
    """The CA's files contradict each other or cannot be read. Restore the directory from a backup."""


class CaBusyError(CaError):
    """Another process holds the CA's register for longer than the time limit; try again."""


class CaStorageError(CaError):
    """The register could not be written (full disk, no permission). Nothing was issued or revoked."""


class CaRequestError(CaError):
    """A name, a kind, an attribute, a host or a lifetime that the CA does not certify; the text names it."""


class AlreadyEnrolledError(CaError):
    """The name holds a certificate that is neither expired nor revoked: renew or revoke that one."""


class UnknownCertificateError(CaError):
    """No certificate of that name, or with that serial number, was issued here (or all are revoked already)."""


class NotInvitedError(CaError):
    """Name and one-time secret do not fit, or no longer: wrong, used before, or expired. Ask for another one."""
