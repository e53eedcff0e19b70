"""Checking a webhook by the Standard Webhooks specification."""

from __future__ import annotations

import binascii
import hashlib
import hmac
import json
import time
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from typing import Any, Final

from wonderland.client.errors import WebhookError

TOLERANCE_S: Final = 300


def verify_webhook(
    secret: str, headers: Mapping[str, str], body: bytes, *, clock: Callable[[], float] = time.time
) -> dict[str, Any]:
    """The content of a webhook's body, after its signature and time were checked. Raises `WebhookError`.

    Whether `headers["webhook-id"]` was seen before is for the receiver to know: then it answers 2xx and does nothing.
    """
    given = {name.lower(): value for name, value in headers.items()}
    message_id, timestamp = given.get("webhook-id", ""), given.get("webhook-timestamp", "")
    if not timestamp.isascii() or not timestamp.isdecimal() or abs(clock() - int(timestamp)) > TOLERANCE_S:
        raise WebhookError("webhook-timestamp is missing, or more than five minutes off")
    try:
        key = b64decode(secret.removeprefix("whsec_"), validate=True)
    except binascii.Error:
        raise WebhookError("the secret is not of the form whsec_…") from None
    mac = hmac.new(key, f"{message_id}.{timestamp}.".encode() + body, hashlib.sha256).digest()
    expected = f"v1,{b64encode(mac).decode()}".encode()
    signatures = given.get("webhook-signature", "").split(" ")
    if not any(hmac.compare_digest(each.encode(), expected) for each in signatures):
        raise WebhookError("webhook-signature is not that of this secret")
    try:
        content = json.loads(body)
    except ValueError:
        raise WebhookError("the body is no JSON") from None
    if not isinstance(content, dict):
        raise WebhookError("the body is no JSON object")
    return content
