"""Certificate authorities. `LocalCa` keeps one per organisation in a directory."""

from wonderland.ledger.ca.application import Kind
from wonderland.ledger.ca.errors import (
    AlreadyEnrolledError,
    CaBusyError,
    CaCorruptError,
    CaError,
    CaExistsError,
    CaNotFoundError,
    CaRequestError,
    CaStorageError,
    NotInvitedError,
    UnknownCertificateError,
)
from wonderland.ledger.ca.invitations import Invitations
from wonderland.ledger.ca.local import Enrolment, LocalCa
from wonderland.ledger.ca.register import IssuedCertificate
from wonderland.ledger.ca.requests import CertificateRequest

__all__ = [
    "AlreadyEnrolledError",
    "CaBusyError",
    "CaCorruptError",
    "CaError",
    "CaExistsError",
    "CaNotFoundError",
    "CaRequestError",
    "CaStorageError",
    "CertificateRequest",
    "Enrolment",
    "Invitations",
    "IssuedCertificate",
    "Kind",
    "LocalCa",
    "NotInvitedError",
    "UnknownCertificateError",
]
