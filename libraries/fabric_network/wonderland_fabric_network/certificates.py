"""Certificates and keys on disk: written so that a crash leaves both or neither, and checked before they are used."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from wonderland_fabric_gateway.ca.certificates import private_key_pem
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_gateway.identity import Identity, SigningIdentity
from wonderland_fabric_gateway.signing import key_file_signer
from wonderland_fabric_network.errors import CertificateStateError, DirectoryStateError

if TYPE_CHECKING:
    from pathlib import Path

    from wonderland_fabric_network.layout import IdentityPaths

RENEW_COMMAND: Final = "`wonderland network renew`"


def store(paths: IdentityPaths, certificate_pem: bytes, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a key (for its owner only) and its certificate. Raises `FileWriteError`, `DirectoryStateError`."""
    for directory in {paths.key.parent, paths.certificate.parent}:
        make_private(directory)
    # Between the two writes key and certificate do not fit; whoever loads them sees that and has them made anew.
    write_atomic(paths.key, private_key_pem(key))
    write_atomic(paths.certificate, certificate_pem, PUBLIC)


def make_private(directory: Path) -> None:
    """Make a directory for its owner only. Raises `DirectoryStateError`."""
    try:
        directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as cause:
        raise DirectoryStateError(f"{directory}: cannot be made ({cause.strerror})") from cause


def fits(paths: IdentityPaths) -> bool:
    """Whether both files are there and the key is the certificate's."""
    if not paths.exist():
        return False
    try:
        certificate = certificate_of(paths.certificate.read_bytes())
        key = load_pem_private_key(paths.key.read_bytes(), None)
        return key.public_key() == certificate.public_key()
    except (OSError, ValueError, TypeError, UnsupportedAlgorithm):
        return False


def load(path: Path) -> x509.Certificate:
    """A certificate of a PEM file. Raises `CertificateStateError`."""
    data = read_bounded(path, CertificateStateError, "certificate")
    try:
        return certificate_of(data)
    except ValueError as cause:
        raise CertificateStateError(f"{path}: no PEM certificate ({cause})") from cause


def load_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """A private key of a PEM file. Raises `CertificateStateError`."""
    try:
        key = load_pem_private_key(read_bounded(path, CertificateStateError, "private key"), None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as cause:
        raise CertificateStateError(f"{path}: no unencrypted PEM private key") from cause
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise CertificateStateError(f"{path}: not an elliptic-curve key")
    return key


def signing_identity(msp_id: str, paths: IdentityPaths) -> SigningIdentity:
    """An identity with its key. Raises `IdentityError`, `SignatureError`."""
    return SigningIdentity(Identity.from_file(msp_id, paths.certificate), key_file_signer(paths.key))


def require_usable(path: Path, root: x509.Certificate, now: dt.datetime, owner: str) -> x509.Certificate:
    """A certificate, seen to be valid now and issued by that root. Raises `CertificateStateError`."""
    certificate = load(path)
    if now > certificate.not_valid_after_utc:
        raise CertificateStateError(
            f"{owner}: its certificate {path} expired on {_day(certificate.not_valid_after_utc)}. Next: {RENEW_COMMAND}"
        )
    if now < certificate.not_valid_before_utc:
        raise CertificateStateError(
            f"{owner}: its certificate {path} is valid only from {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} "
            f"UTC, and this machine says that it is {now:%Y-%m-%d %H:%M} UTC. Next: set the clock right"
        )
    try:
        certificate.verify_directly_issued_by(root)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm) as cause:
        raise CertificateStateError(
            f"{owner}: its certificate {path} was issued by {certificate.issuer.rfc4514_string()!r}, not by its "
            f"organisation's CA {root.subject.rfc4514_string()!r}. Next: put the right file back, or delete it and run "
            "`wonderland network up`, which enrols anew"
        ) from cause
    return certificate


def _day(moment: dt.datetime) -> str:
    return moment.strftime("%Y-%m-%d")
