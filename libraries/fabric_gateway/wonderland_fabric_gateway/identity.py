"""Who signs: an MSP id and an X.509 certificate, as Fabric serialises them (``msp.SerializedIdentity``)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from cryptography.x509.oid import NameOID
from fabric_protos.msp import identities_pb2

from wonderland_fabric_gateway import attributes as attrs
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.errors import IdentityError, SignatureError
from wonderland_fabric_gateway.files import read_bounded
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signing import require_p256

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

    from wonderland_fabric_gateway.signing import Signer

MAX_CREATOR_BYTES: Final = 65_536
MAX_MSP_ID_CHARS: Final = 128
NODE_OUS: Final = frozenset({"client", "peer", "admin", "orderer"})


@dataclass(frozen=True)
class Identity:
    """An MSP id and a PEM certificate. Nothing here says that the certificate is trusted; a membership check does.

    The certificate is parsed when first asked for, once. Every property that needs it raises `IdentityError` when
    it cannot be read.
    """

    msp_id: str
    certificate_pem: bytes

    @classmethod
    def from_file(cls, msp_id: str, path: Path) -> Identity:
        """An identity with the certificate of a PEM file, checked to be one. Raises `IdentityError`."""
        identity = cls(msp_id, read_bounded(path, IdentityError, "certificate", MAX_CREATOR_BYTES))
        _ = identity.certificate
        return identity

    @staticmethod
    def from_creator(creator: bytes) -> Identity:
        """Parse a SerializedIdentity. The certificate is parsed, too: what comes back is readable, not yet trusted.

        Recent ones are remembered, so that a certificate seen in each block is parsed once. Raises `IdentityError`.
        """
        return _from_creator(creator)

    @cached_property
    def creator(self) -> bytes:
        """The SerializedIdentity: what a transaction names as its creator and an endorsement as its endorser."""
        return bytes(
            identities_pb2.SerializedIdentity(mspid=self.msp_id, id_bytes=self.certificate_pem).SerializeToString()
        )

    @cached_property
    def certificate(self) -> x509.Certificate:
        """The parsed certificate."""
        try:
            return certificate_of(self.certificate_pem)
        except ValueError as cause:
            raise IdentityError(f"{self.msp_id}: the certificate is no PEM X.509 certificate ({cause})") from cause

    @cached_property
    def certificate_der(self) -> bytes:
        """The certificate's DER encoding."""
        return self.certificate.public_bytes(Encoding.DER)

    @cached_property
    def certificate_sha256(self) -> str:
        """Lower-case hex SHA-256 over the DER certificate: the certificate's name in transcripts and segments."""
        return hashlib.sha256(self.certificate_der).hexdigest()

    @cached_property
    def public_key(self) -> ec.EllipticCurvePublicKey:
        """The P-256 key. Raises `IdentityError` for any other kind."""
        try:
            return require_p256(self.certificate.public_key())
        except (SignatureError, ValueError, UnsupportedAlgorithm) as cause:
            raise IdentityError(f"{self.msp_id}: the certificate's key cannot be used ({cause})") from cause

    @cached_property
    def public_key_bytes(self) -> bytes:
        """The public key as an uncompressed point, 65 bytes: 0x04 ‖ x ‖ y (SEC 1, 2.3.3)."""
        return self.public_key.public_bytes(Encoding.X962, PublicFormat.UncompressedPoint)

    @cached_property
    def attributes(self) -> dict[str, str]:
        """The Fabric CA attributes by name; empty when the certificate has none."""
        try:
            extension = self.certificate.extensions.get_extension_for_oid(attrs.ATTRIBUTES_OID).value
        except x509.ExtensionNotFound:
            return {}
        except (ValueError, UnsupportedAlgorithm, x509.DuplicateExtension) as cause:
            raise IdentityError(f"{self.msp_id}: the certificate's extensions cannot be read ({cause})") from cause
        if not isinstance(extension, x509.UnrecognizedExtension):
            raise IdentityError(f"{self.msp_id}: the certificate's attribute extension cannot be read")
        return attrs.decode_attributes(extension.value)

    @cached_property
    def common_name(self) -> str:
        """The subject's CN, which Fabric CA makes the enrolment id; "" without one."""
        names = self._subject(NameOID.COMMON_NAME)
        return names[0] if names else ""

    @cached_property
    def node_ou(self) -> str:
        """client, peer, admin or orderer; "" when the subject has none of them, or more than one."""
        units = [unit for unit in self._subject(NameOID.ORGANIZATIONAL_UNIT_NAME) if unit in NODE_OUS]
        return units[0] if len(units) == 1 else ""

    @property
    def role(self) -> str:
        """The attribute pol.role; "" without one."""
        return self.attributes.get(attrs.ROLE, "")

    @property
    def pol_id(self) -> str:
        """The attribute pol.id; "" without one."""
        return self.attributes.get(attrs.ID, "")

    def _subject(self, oid: x509.ObjectIdentifier) -> list[str]:
        try:
            values = [attribute.value for attribute in self.certificate.subject.get_attributes_for_oid(oid)]
        except (ValueError, KeyError) as cause:  # KeyError: string types that cryptography does not know
            raise IdentityError(f"{self.msp_id}: the certificate's subject cannot be read ({cause})") from cause
        return [value for value in values if isinstance(value, str)]


@dataclass(frozen=True)
class SigningIdentity:
    """An identity together with the means to sign as it."""

    identity: Identity
    sign: Signer

    @property
    def creator(self) -> bytes:
        """The SerializedIdentity (protobuf), as it stands in a transaction's header."""
        return self.identity.creator


@lru_cache(maxsize=1024)
def _from_creator(creator: bytes) -> Identity:
    if len(creator) > MAX_CREATOR_BYTES:
        raise IdentityError(f"a serialised identity of {len(creator)} bytes; the limit is {MAX_CREATOR_BYTES}")
    message = decode(identities_pb2.SerializedIdentity, creator, "serialised identity", IdentityError)
    if not message.mspid:
        raise IdentityError("the serialised identity names no MSP")
    if len(message.mspid) > MAX_MSP_ID_CHARS:
        raise IdentityError(f"the serialised identity's MSP id has {len(message.mspid)} characters")
    identity = Identity(message.mspid, message.id_bytes)
    _ = identity.certificate
    # The very bytes that were hashed and signed stand, whatever a re-serialisation would give.
    identity.__dict__["creator"] = creator
    return identity
