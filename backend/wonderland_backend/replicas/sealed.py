"""What backends say is sealed with a key that stands in their database.

A router of the bus knows names of certificates, not who issued them (decision 0044): whoever has a backend's name from
another authority that the router trusts would else read requests, and could make up positions.
"""

from __future__ import annotations

import os
from typing import Final

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

KEY_BYTES: Final = 32
_NONCE_BYTES: Final = 12
_TIME_BYTES: Final = 8
FRESH_MS: Final = 60_000
"""A question that was asked longer ago is somebody's who kept it, or the clocks of two backends differ by as much."""


class Seal:
    """Closes and opens. `about`: what it is an answer to, or where it was said; it opens as that only."""

    def __init__(self, key: bytes) -> None:
        self._aead = ChaCha20Poly1305(key)

    def closed(self, data: bytes, about: bytes, now_ms: int) -> bytes:
        """Sealed."""
        nonce = os.urandom(_NONCE_BYTES)
        return nonce + self._aead.encrypt(nonce, now_ms.to_bytes(_TIME_BYTES) + data, about)

    def opened(self, data: bytes, about: bytes, now_ms: int) -> bytes:
        """Raises `ValueError` for what was not sealed with this key, about this, just now."""
        try:
            found = self._aead.decrypt(data[:_NONCE_BYTES], data[_NONCE_BYTES:], about)
        except (InvalidTag, ValueError):
            raise ValueError("not sealed with the key of this database") from None
        age_ms = now_ms - int.from_bytes(found[:_TIME_BYTES])
        if abs(age_ms) > FRESH_MS:
            raise ValueError(f"sealed {age_ms / 1000:.0f} s ago; are the clocks of all backends right?")
        return found[_TIME_BYTES:]
