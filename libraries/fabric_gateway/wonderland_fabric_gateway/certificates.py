"""Certificates, requests and revocation lists read from bytes of others.

`cryptography` says with three kinds of exceptions that bytes cannot be read, and one of them, `InvalidVersion`, is no
`ValueError`: a certificate of version 5 would go through every `except ValueError`. Here it is one.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from cryptography import x509

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def _as_value_error() -> Iterator[None]:
    try:
        yield
    except x509.InvalidVersion as cause:
        raise ValueError(str(cause)) from cause


def certificate_of(pem: bytes) -> x509.Certificate:
    """The first certificate of a PEM text. Raises ValueError."""
    with _as_value_error():
        return x509.load_pem_x509_certificate(pem)


def certificates_of(pem: bytes) -> list[x509.Certificate]:
    """Every certificate of a PEM text, at least one. Raises ValueError."""
    with _as_value_error():
        return x509.load_pem_x509_certificates(pem)


def certificate_of_der(der: bytes) -> x509.Certificate:
    """A certificate in DER. Raises ValueError."""
    with _as_value_error():
        return x509.load_der_x509_certificate(der)


def request_of(pem: bytes) -> x509.CertificateSigningRequest:
    """A certificate request (PKCS #10) of a PEM text. Raises ValueError."""
    with _as_value_error():
        return x509.load_pem_x509_csr(pem)


def revocation_list_of(pem: bytes) -> x509.CertificateRevocationList:
    """A certificate revocation list of a PEM text. Raises ValueError."""
    with _as_value_error():
        return x509.load_pem_x509_crl(pem)
