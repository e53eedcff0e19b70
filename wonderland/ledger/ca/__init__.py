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
    UnknownCertificateError,
)
from wonderland.ledger.ca.local import Enrolment, LocalCa
from wonderland.ledger.ca.register import IssuedCertificate

__all__ = [
    "AlreadyEnrolledError",
    "CaBusyError",
    "CaCorruptError",
    "CaError",
    "CaExistsError",
    "CaNotFoundError",
    "CaRequestError",
    "CaStorageError",
    "Enrolment",
    "IssuedCertificate",
    "Kind",
    "LocalCa",
    "UnknownCertificateError",
]
