"""Decoding protocol buffers at a boundary: whatever is wrong with foreign bytes becomes one typed error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from google.protobuf.message import DecodeError

if TYPE_CHECKING:
    from wonderland_fabric_gateway.errors import LedgerError


def decode(message_type: Any, data: bytes, what: str, error: type[LedgerError]) -> Any:
    """Parse `data` as `message_type` (a generated class); `error` with `what` in its text when it is not one.

    Strings that are no UTF-8, truncation, absurd lengths and nesting beyond 100 levels are all refused here.
    """
    try:
        return message_type.FromString(data)
    except (DecodeError, RecursionError) as cause:
        raise error(f"{what}: {len(data)} bytes that are no {message_type.DESCRIPTOR.full_name} ({cause})") from cause
