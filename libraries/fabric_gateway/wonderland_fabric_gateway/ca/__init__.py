"""Certificate authorities. `LocalCa` keeps one per organisation in a directory."""

from wonderland_fabric_gateway.ca.application import Kind
from wonderland_fabric_gateway.ca.errors import (
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
from wonderland_fabric_gateway.ca.invitations import Invitations
from wonderland_fabric_gateway.ca.local import Enrolment, LocalCa
from wonderland_fabric_gateway.ca.register import IssuedCertificate
from wonderland_fabric_gateway.ca.requests import CertificateRequest

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
