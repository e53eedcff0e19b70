"""Whose a certificate is: its common name, by which Zenoh goes, and its issuer, which Zenoh does not see."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from typing import Final, Self

from cryptography import x509
from cryptography.x509.oid import NameOID

from wonderland_bus.errors import BusSettingsError

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
ISSUER_CHARS: Final = 32


def is_name(name: str) -> bool:
    """Whether a common name can be part of a key: no slash, and none of a key expression's signs."""
    return _NAME.fullmatch(name) is not None


@dataclass(frozen=True, slots=True)
class Peer:
    """Who holds a certificate. Two organisations may each have a ``pad-1``: their issuers differ."""

    name: str
    issuer: str
    """Of the issuer's name and of the key that signed, 128 bits, hexadecimal."""

    @classmethod
    def of(cls, certificate: x509.Certificate) -> Self:
        """Raises `BusSettingsError` for a certificate without a name that can be used."""
        names = [str(each.value) for each in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
        if len(names) != 1 or not is_name(names[0]):
            raise BusSettingsError(
                f"the certificate's common name {names!r} is no name on the bus: one, of letters, digits and ._@-"
            )
        return cls(names[0], _issuer(certificate))


def _issuer(certificate: x509.Certificate) -> str:
    digest = hashlib.sha256(certificate.issuer.public_bytes())
    try:
        key_id = certificate.extensions.get_extension_for_class(x509.AuthorityKeyIdentifier).value.key_identifier
    except x509.ExtensionNotFound:
        key_id = None
    digest.update(key_id or b"")  # one authority that renewed its key under its old name is two
    return digest.hexdigest()[:ISSUER_CHARS]
