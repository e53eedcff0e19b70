"""RFC 3161 time-stamps over the header hashes of a bundle's blocks, checked against pinned roots.

A token is a CMS SignedData (RFC 5652) around a TSTInfo. What is accepted: one signer, SHA-256 or longer, ECDSA or RSA,
whose certificate has the extended key usage timeStamping alone and critical, is named by the signed attributes, and was
valid at the time that it states.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final

from asn1crypto import cms, tsp
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, padding, rsa
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID

from wonderland_evidence.errors import NotCheckedError, StepError
from wonderland_fabric_gateway.certificates import certificate_of_der

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland_evidence.case import Case
    from wonderland_evidence.trust import Pins

_HASHES: Final[dict[str, hashes.HashAlgorithm]] = {
    "sha256": hashes.SHA256(),
    "sha384": hashes.SHA384(),
    "sha512": hashes.SHA512(),
}
MAX_CHAIN: Final = 5


@dataclass(frozen=True)
class Stamped:
    """What a token says: when, and of which hash. `nonce` is the asker's."""

    at: datetime
    imprint: bytes
    nonce: int | None


def check(case: Case, pins: Pins) -> str:
    """What the time-stamps say. Raises `NotCheckedError` where there are none or no roots for them, `StepError`."""
    stamps = case.bundle.timestamps
    if not stamps:
        raise NotCheckedError("the file has no time-stamp")
    if not pins.timestamp_roots:
        raise NotCheckedError("the trust file pins no root of a time-stamping service")
    said = []
    for each in stamps:
        block = case.blocks.get(each.block)
        if block is None:
            raise StepError(f"a time-stamp of block {each.block}, which is not in the file")
        stamped = read_token(each.token, pins.timestamp_roots)
        if stamped.imprint != block.header.hash:
            raise StepError(f"the time-stamp of block {each.block} is of something else")
        said.append(f"block {each.block} not later than {stamped.at.isoformat(timespec='seconds')}")
    return ", ".join(said)


def read_token(token: bytes, roots: Sequence[x509.Certificate]) -> Stamped:
    """A token that holds under one of these roots. Raises `StepError`."""
    try:
        return _read(token, roots)
    except StepError:
        raise
    except InvalidSignature as cause:
        raise StepError("the time-stamp's signature does not hold") from cause
    except Exception as cause:  # bytes of strangers: the ASN.1 library raises whatever it meets
        raise StepError(f"a time-stamp that cannot be read ({type(cause).__name__}: {cause})") from cause


def _read(token: bytes, roots: Sequence[x509.Certificate]) -> Stamped:
    outer = cms.ContentInfo.load(token, strict=True)
    if outer["content_type"].native != "signed_data" or outer.dump(force=True) != token:
        raise StepError("a time-stamp that is no CMS SignedData in DER")
    signed = outer["content"]
    content = signed["encap_content_info"]
    if content["content_type"].native != "tst_info" or len(signed["signer_infos"]) != 1:
        raise StepError("a time-stamp without a TSTInfo, or of several signers")
    signer = signed["signer_infos"][0]
    body: bytes = content["content"].contents
    certificates = [certificate_of_der(each.chosen.dump()) for each in signed["certificates"]]
    leaf = _signing_certificate(signer, body, certificates)
    _require_nothing_loose(signed, signer, leaf)
    info: Any = tsp.TSTInfo.load(body, strict=True)
    imprint = info["message_imprint"]
    if imprint["hash_algorithm"]["algorithm"].native != "sha256":
        raise StepError("a time-stamp of another hash than SHA-256")
    at: datetime = info["gen_time"].native
    chain = _chain(leaf, certificates, roots, at)
    if any(each not in chain for each in certificates):
        raise StepError("a time-stamp with certificates that nothing rests on")
    return Stamped(at, imprint["hashed_message"].native, info["nonce"].native)


def _signing_certificate(signer: Any, body: bytes, certificates: Sequence[x509.Certificate]) -> x509.Certificate:
    """The certificate that the signed attributes name, and with which the signature over them holds."""
    digest = _HASHES[signer["digest_algorithm"]["algorithm"].native]
    attributes = {each["type"].native: each["values"] for each in signer["signed_attrs"]}
    named = attributes.get("signing_certificate_v2") or attributes.get("signing_certificate")
    if attributes["content_type"][0].native != "tst_info" or named is None:
        raise StepError("a time-stamp whose signed attributes name no content or no certificate")
    if attributes["message_digest"][0].native != hashlib.new(digest.name, body).digest():
        raise StepError("a time-stamp whose content was changed")
    identified = named[0]["certs"][0]
    name = "sha1" if "signing_certificate_v2" not in attributes else identified["hash_algorithm"]["algorithm"].native
    for certificate in certificates:
        der = certificate.public_bytes(Encoding.DER)
        if hashlib.new(name, der, usedforsecurity=False).digest() == identified["cert_hash"].native:
            break
    else:
        raise StepError("a time-stamp without the certificate that it names")
    message = b"\x31" + signer["signed_attrs"].dump(force=True)[1:]  # signed as the SET OF that it is (RFC 5652, 5.4)
    signature: bytes = signer["signature"].native
    key = certificate.public_key()
    if isinstance(key, ec.EllipticCurvePublicKey):
        key.verify(signature, message, ec.ECDSA(digest))
    elif isinstance(key, rsa.RSAPublicKey):
        key.verify(signature, message, padding.PKCS1v15(), digest)
    else:
        raise StepError("a time-stamp by a key of a kind that is not known")
    return certificate


def _require_nothing_loose(signed: Any, signer: Any, leaf: x509.Certificate) -> None:
    """What no signature covers has one value only, so that no byte of a token can be another. Raises `StepError`."""
    digest = signer["digest_algorithm"]
    method = signer["signature_algorithm"]
    named = signer["sid"].chosen
    kind = "ecdsa" if isinstance(leaf.public_key(), ec.EllipticCurvePublicKey) else "rsassa_pkcs1v15"
    plain = method["algorithm"].native == "rsassa_pkcs1v15"  # as OpenSSL names it: the hash is the digest's
    if not (
        signed["version"].native == "v3"
        and signer["version"].native == "v1"
        and [each.dump() for each in signed["digest_algorithms"]] == [digest.dump()]
        and digest["parameters"].native is None
        and method["parameters"].native is None
        and method.signature_algo == kind
        and (plain or method.hash_algo == digest["algorithm"].native)
        and signed["crls"].native is None
        and signer["unsigned_attrs"].native is None
        and signer["sid"].name == "issuer_and_serial_number"
        and named["issuer"].dump() == leaf.issuer.public_bytes()
        and named["serial_number"].native == leaf.serial_number
    ):
        raise StepError("a time-stamp with parts that nobody signed and that do not fit")


def _chain(
    leaf: x509.Certificate, certificates: Sequence[x509.Certificate], roots: Sequence[x509.Certificate], at: datetime
) -> list[x509.Certificate]:
    """From the signer to a pinned root, all of it valid then. Raises `StepError`."""
    usage = leaf.extensions.get_extension_for_class(x509.ExtendedKeyUsage)
    if not usage.critical or list(usage.value) != [ExtendedKeyUsageOID.TIME_STAMPING]:
        raise StepError("a time-stamp by a certificate that is not for time-stamping alone")
    current = leaf
    chain: list[x509.Certificate] = []
    for _ in range(MAX_CHAIN):
        chain.append(current)
        if not current.not_valid_before_utc <= at <= current.not_valid_after_utc:
            raise StepError("a time-stamp of a time at which its certificates were not valid")
        if current in roots:
            return chain
        issuer = next((each for each in (*roots, *certificates) if _issued(each, current)), None)
        if issuer is None:
            break
        current = issuer
    raise StepError("a time-stamp whose certificate does not lead to a pinned root")


def _issued(issuer: x509.Certificate, certificate: x509.Certificate) -> bool:
    if issuer == certificate:
        return False
    try:
        constraints = issuer.extensions.get_extension_for_class(x509.BasicConstraints).value
        certificate.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature, x509.ExtensionNotFound):
        return False
    return constraints.ca
