"""Signatures by the Standard Webhooks specification: for every language there is a library that checks them.

A request carries ``webhook-id`` (the same when it is sent again), ``webhook-timestamp`` (seconds) and
``webhook-signature`` (``v1,`` and base64 of HMAC-SHA256 over ``id.timestamp.body``). A receiver checks the signature,
refuses a timestamp more than five minutes off, and does nothing for an id that it has seen.
"""

from __future__ import annotations

import hashlib
import hmac
from base64 import b64decode, b64encode
from collections.abc import Callable
from typing import Final

PREFIX: Final = "whsec_"
KEY_BYTES: Final = 32


def new_secret(randomness: Callable[[int], bytes]) -> str:
    """A secret to be shared with the receiver."""
    return PREFIX + b64encode(randomness(KEY_BYTES)).decode()


def key_of(secret: str) -> bytes:
    """The key in a secret; of one without the prefix, its text."""
    return b64decode(secret.removeprefix(PREFIX)) if secret.startswith(PREFIX) else secret.encode()


def headers(secret: str, message_id: str, t_s: int, body: bytes) -> dict[str, str]:
    """The three headers of a message."""
    signed = f"{message_id}.{t_s}.".encode() + body
    mac = hmac.new(key_of(secret), signed, hashlib.sha256).digest()
    return {
        "webhook-id": message_id,
        "webhook-timestamp": str(t_s),
        "webhook-signature": f"v1,{b64encode(mac).decode()}",
    }
