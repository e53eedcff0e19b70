"""Signatures as Fabric wants them: ECDSA on P-256 over SHA-256, DER, low-S.

A `Signer` is any function from a message to such a signature, so that a key may live in a file, a TPM or behind
PKCS#11. Fabric refuses the high-S twin of a signature, because otherwise anyone could turn one valid signature
into another; so does `verify`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeAlias

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.files import read_bounded

if TYPE_CHECKING:
    from pathlib import Path

Signer: TypeAlias = Callable[[bytes], bytes]
"""Message → DER, low-S ECDSA P-256/SHA-256 signature. The message is hashed by the signer."""

P256_ORDER: Final = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
_HALF_ORDER: Final = P256_ORDER // 2
_ALGORITHM: Final = ec.ECDSA(hashes.SHA256())
_COORDINATE_BYTES: Final = 32
_IN_HARDWARE: Final = b"pkcs11:"
_MAX_DER_BYTES: Final = 72  # SEQUENCE of two INTEGERs of at most 33 bytes


def key_signer(private_key: ec.EllipticCurvePrivateKey) -> Signer:
    """A signer with a key in memory. Raises `SignatureError` unless the key is on P-256."""
    if not isinstance(private_key.curve, ec.SECP256R1):
        raise SignatureError("the private key is not on P-256 (secp256r1); enrol again with a P-256 key")

    def sign(message: bytes) -> bytes:
        der = private_key.sign(message, _ALGORITHM)
        r, s = decode_dss_signature(der)
        return der if s <= _HALF_ORDER else encode_dss_signature(r, P256_ORDER - s)

    return sign


def key_file_signer(path: Path) -> Signer:
    """A signer with the key of an unencrypted PEM file (PKCS#8 or SEC 1), or of the hardware module that it names.

    Raises `SignatureError`.
    """
    return key_signer(private_key(path))


def private_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """The key of such a file; one in a hardware module signs there, and cannot be read. Raises `SignatureError`."""
    data = read_bounded(path, SignatureError, "private key")
    if is_in_hardware(data):
        return _hardware_key(path, data)
    try:
        key = load_pem_private_key(data, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as cause:
        # The library's text is not passed on: it may quote the file.
        raise SignatureError(f"{path}: no unencrypted PEM private key") from cause
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise SignatureError(f"{path}: not an elliptic-curve key; Fabric identities are P-256")
    return key


def is_in_hardware(key_file: bytes) -> bool:
    """Whether a key's file names a hardware module (PKCS#11) instead of holding the key."""
    return key_file.startswith(_IN_HARDWARE)


def _hardware_key(path: Path, data: bytes) -> ec.EllipticCurvePrivateKey:
    from wonderland_fabric_gateway.hsm import HsmKey, HsmPrivateKey  # noqa: PLC0415 - most never need it

    try:
        return HsmPrivateKey(HsmKey.parse(data.decode().strip()))
    except UnicodeDecodeError as cause:
        raise SignatureError(f"{path}: its PKCS#11 URI is no text") from cause
    except SignatureError as cause:
        raise SignatureError(f"{path}: {cause}") from cause


def verify(public_key: ec.EllipticCurvePublicKey, message: bytes, signature: bytes) -> None:
    """Check a DER signature over `message`; raise `SignatureError` unless it is valid, low-S and on P-256."""
    require_p256(public_key)
    _, s = _der_numbers(signature)
    if s > _HALF_ORDER:
        raise SignatureError("high-S signature: Fabric accepts only the low-S form (s ≤ n/2)")
    try:
        public_key.verify(signature, message, _ALGORITHM)
    except InvalidSignature as cause:
        raise SignatureError("the signature was not made by this key over this message") from cause


def require_p256(public_key: object) -> ec.EllipticCurvePublicKey:
    """The key itself when it is an ECDSA key on P-256, else `SignatureError`."""
    if not isinstance(public_key, ec.EllipticCurvePublicKey) or not isinstance(public_key.curve, ec.SECP256R1):
        raise SignatureError("the public key is not an ECDSA key on P-256 (secp256r1)")
    return public_key


def raw_from_der(signature: bytes) -> bytes:
    """DER → r ‖ s, 32 bytes each, big-endian (IEEE P1363, as a UWB segment carries it). Raises `SignatureError`."""
    r, s = _der_numbers(signature)
    return r.to_bytes(_COORDINATE_BYTES, "big") + s.to_bytes(_COORDINATE_BYTES, "big")


def der_from_raw(signature: bytes) -> bytes:
    """R ‖ s (64 bytes) → DER. Raises `SignatureError` for another length, or numbers outside 1 … n−1."""
    if len(signature) != 2 * _COORDINATE_BYTES:
        raise SignatureError(f"a raw P-256 signature has 64 bytes, not {len(signature)}")
    r = int.from_bytes(signature[:_COORDINATE_BYTES], "big")
    s = int.from_bytes(signature[_COORDINATE_BYTES:], "big")
    _require_in_range(r, s)
    return encode_dss_signature(r, s)


def _der_numbers(signature: bytes) -> tuple[int, int]:
    if len(signature) > _MAX_DER_BYTES:
        raise SignatureError(f"a DER P-256 signature has at most {_MAX_DER_BYTES} bytes, not {len(signature)}")
    try:
        r, s = decode_dss_signature(signature)
    except ValueError as cause:
        raise SignatureError("the signature is no DER SEQUENCE of two INTEGERs") from cause
    _require_in_range(r, s)
    return r, s


def _require_in_range(r: int, s: int) -> None:
    if not (0 < r < P256_ORDER and 0 < s < P256_ORDER):
        raise SignatureError("signature numbers outside 1 … n−1")
