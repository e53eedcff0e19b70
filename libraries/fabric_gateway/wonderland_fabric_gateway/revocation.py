"""Revocation lists, checked before they get onto a channel, where a bad one does harm.

Fabric silently ignores a list that was signed by another key, and a list without the authority key identifier makes
every identity of the organisation invalid, its administrators included.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec

from wonderland_fabric_gateway.certificates import certificate_of, revocation_list_of
from wonderland_fabric_gateway.errors import IdentityError, RevocationListError

if TYPE_CHECKING:
    from collections.abc import Iterable


def check_revocation_list(crl_pem: bytes, roots: Iterable[bytes]) -> x509.CertificateRevocationList:
    """Parse a PEM list that one of these CA certificates issued. Raises `RevocationListError`.

    Stricter than Fabric on purpose: it silently ignores a list signed by another key, and a list without the
    authority key identifier makes every identity of the organisation invalid.
    """
    try:
        crl = revocation_list_of(crl_pem)
        key_id = crl.extensions.get_extension_for_class(x509.AuthorityKeyIdentifier).value.key_identifier
    except x509.ExtensionNotFound as cause:
        raise RevocationListError("the revocation list has no authority key identifier; issue it again") from cause
    except (ValueError, UnsupportedAlgorithm, x509.DuplicateExtension) as cause:
        raise RevocationListError(f"no PEM revocation list ({cause})") from cause
    for pem in roots:
        issuer = certificate_of(pem)
        if issuer.subject == crl.issuer and subject_key_id(issuer) == key_id:
            public_key = issuer.public_key()
            if isinstance(public_key, ec.EllipticCurvePublicKey) and crl.is_signature_valid(public_key):
                return crl
            raise RevocationListError("the revocation list was not signed by the CA that it names")
    raise RevocationListError(
        f"the revocation list's issuer {crl.issuer.rfc4514_string()!r} is no CA of that organisation"
    )


def subject_key_id(certificate: x509.Certificate) -> bytes:
    """The identifier of a certificate's key, b"" when it names none. Raises `IdentityError`."""
    try:
        return certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value.digest
    except x509.ExtensionNotFound:
        return b""
    except (ValueError, x509.DuplicateExtension) as cause:
        raise IdentityError(f"a certificate's extensions cannot be read ({cause})") from cause
