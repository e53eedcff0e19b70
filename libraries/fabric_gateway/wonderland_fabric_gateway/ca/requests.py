"""A certificate request (PKCS#10) that an applicant made with a key of his own: a browser, a token, another machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from wonderland_fabric_gateway.ca.errors import CaRequestError
from wonderland_fabric_gateway.certificates import request_of
from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.signing import private_key, require_p256

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

MAX_BYTES: Final = 8_192
TLS_PROFILE: Final = "tls"
"""By which a Fabric CA certifies for TLS, not for signing."""


@dataclass(frozen=True, slots=True)
class CertificateRequest:
    """A request whose own signature was checked: who made it holds the private key. `name` is the subject's CN."""

    pem: str
    name: str
    public_key: ec.EllipticCurvePublicKey

    @classmethod
    def of_key_file(cls, name: str, path: Path) -> CertificateRequest:
        """A request with the key of a file, or of the hardware module that it names. Raises `SignatureError`."""
        key = private_key(path)
        # Fabric CA insists: the CN is the enrolment id.
        builder = x509.CertificateSigningRequestBuilder(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
        return cls(builder.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM).decode(), name, key.public_key())

    @classmethod
    def parse(cls, pem: str) -> CertificateRequest:
        """Read a PEM request. Raises `CaRequestError`, naming what is wrong."""
        if len(pem) > MAX_BYTES:
            raise CaRequestError(f"a certificate request of {len(pem)} characters; at most {MAX_BYTES}")
        try:
            request = request_of(pem.encode("ascii"))
            signed = request.is_signature_valid
            names = [each.value for each in request.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
            key = require_p256(request.public_key())
        except SignatureError as cause:
            raise CaRequestError(f"certificate request: {cause}") from cause
        except (ValueError, KeyError, UnsupportedAlgorithm) as cause:
            raise CaRequestError(f"no PEM certificate request that can be read ({cause})") from cause
        if not signed:
            raise CaRequestError("the certificate request is not signed by the key that it names")
        if len(names) != 1 or not isinstance(names[0], str):
            raise CaRequestError("the certificate request's subject must have one common name (CN): the enrolment id")
        return cls(pem, names[0], key)
