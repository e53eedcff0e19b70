"""The contract's whole need of cryptography: is this a point of P-256, does this signature hold.

Both are exact (valid or not, the same on every machine); no secret is ever here.
"""

from __future__ import annotations

from typing import Final

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature

P256_ORDER: Final = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
_HALF_ORDER: Final = P256_ORDER >> 1
_POINT_BYTES: Final = 65
_NUMBER_BYTES: Final = 32


def is_point(public_key: bytes) -> bool:
    """Whether these are the 65 bytes (SEC 1, uncompressed) of a point on P-256."""
    return _key(public_key) is not None


def signature_holds(public_key: bytes, message: bytes, signature: bytes) -> bool:
    """Whether ``signature`` (r ‖ s, 64 B, big-endian) is the key's ECDSA signature (SHA-256) over the message.

    False too for s > n/2: each signature has a twin with n − s, and only one of the two may count.
    """
    key = _key(public_key)
    if key is None or len(signature) != 2 * _NUMBER_BYTES:
        return False
    r = int.from_bytes(signature[:_NUMBER_BYTES], "big")
    s = int.from_bytes(signature[_NUMBER_BYTES:], "big")
    if not (0 < r < P256_ORDER and 0 < s <= _HALF_ORDER):
        return False
    try:
        key.verify(encode_dss_signature(r, s), message, ec.ECDSA(hashes.SHA256()))
    except InvalidSignature:
        return False
    return True


def _key(public_key: bytes) -> ec.EllipticCurvePublicKey | None:
    if len(public_key) != _POINT_BYTES or public_key[0] != 4:
        return None
    try:
        return ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), public_key)
    except ValueError:
        return None
