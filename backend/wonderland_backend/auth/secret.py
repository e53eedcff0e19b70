"""Secrets that a browser or a link carries; the server keeps their hashes."""

from __future__ import annotations

import hashlib
from base64 import urlsafe_b64encode
from collections.abc import Callable
from typing import Final

SECRET_BYTES: Final = 32
MAX_SECRET: Final = 128


def new_secret(randomness: Callable[[int], bytes]) -> str:
    """256 random bits as base64url."""
    return urlsafe_b64encode(randomness(SECRET_BYTES)).rstrip(b"=").decode()


def new_id(randomness: Callable[[int], bytes]) -> str:
    """An identifier that nobody can guess or meet twice: 128 bits, hexadecimal."""
    return randomness(16).hex()


def sha256(text: str) -> str:
    """The hash that is kept (hexadecimal)."""
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()
