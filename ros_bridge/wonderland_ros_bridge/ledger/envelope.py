"""What an asset of a bridge holds: some messages of one topic, byte for byte as they were published.

Nothing is left out of a message: a covariance, a NaN or a field that nobody here knows of comes back as it was. A
message that is too large, or of a topic that is to go by hash, is there by its SHA-256 and size.
"""

from __future__ import annotations

import hashlib
from typing import Annotated, Final, Literal

from msgspec import Meta, MsgspecError, Struct
from msgspec import json as msgspec_json

from wonderland_ros_bridge.errors import EnvelopeError

FORMAT: Final = 1
MEDIA_TYPE: Final = "application/vnd.wonderland.ros-messages+json"
DEFINITION_MEDIA_TYPE: Final = "text/vnd.ros.message-definition"
MAX_ID: Final = 128
"""Characters of an asset's id, as the contract bounds it."""
MAX_VALUE_CHARACTERS: Final = 512 * 1024
"""Of an asset's value, as the contract bounds it."""
MAX_MESSAGES: Final = 1_000
OVERHEAD_CHARACTERS: Final = 160
"""What one message takes besides its bytes."""

Encoding = Literal["ros1", "cdr"]
Count = Annotated[int, Meta(ge=0, lt=2**53)]
Name = Annotated[str, Meta(min_length=1, max_length=255, pattern=r"\A[A-Za-z0-9_/~.:-]+\Z")]
TypeHash = Annotated[str, Meta(min_length=32, max_length=80, pattern=r"\A[A-Za-z0-9_]+\Z")]


class Message(Struct, frozen=True, omit_defaults=True):
    """One message: its bytes, or their digest. ``seq`` counts what was received of the topic, so gaps show."""

    seq: Count
    t_ms: Count
    """When the bridge received it (Unix, ms)."""
    data: bytes | None = None
    sha256: Annotated[str, Meta(pattern=r"\A[0-9a-f]{64}\Z")] | None = None
    size: Count | None = None
    """Bytes of a message that is there by its digest alone."""

    def __post_init__(self) -> None:
        if (self.data is None) == (self.sha256 is None):
            raise ValueError("has bytes or a digest")


class Batch(Struct, frozen=True):
    """Messages of one topic and type, in the order in which they came: what one transaction brings."""

    bridge: Name
    epoch: Annotated[str, Meta(pattern=r"\A[0-9a-f]{16}\Z")]
    """Of the bridge's spool: it is drawn when the spool is made, so that numbers of a lost one are not met again."""
    batch: Count
    topic: Name
    encoding: Encoding
    type: Annotated[str, Meta(min_length=3, max_length=128, pattern=r"\A[A-Za-z0-9_/]+\Z")]
    type_hash: TypeHash
    messages: Annotated[tuple[Message, ...], Meta(min_length=1, max_length=MAX_MESSAGES)]
    format: Literal[1] = FORMAT

    def value(self) -> str:
        """The asset's value: JSON, bytes in Base64."""
        return msgspec_json.encode(self).decode()


_DECODER: Final = msgspec_json.Decoder(Batch)


def parse(value: str) -> Batch:
    """The messages of an asset's value. Raises EnvelopeError."""
    if len(value) > MAX_VALUE_CHARACTERS:
        raise EnvelopeError(f"a value of {len(value)} characters; a bridge writes {MAX_VALUE_CHARACTERS} at most")
    try:
        return _DECODER.decode(value)
    except (MsgspecError, UnicodeError, RecursionError) as cause:
        raise EnvelopeError(f"no messages of a bridge: {cause}") from cause


def by_digest(seq: int, t_ms: int, data: bytes) -> Message:
    """A message of which the ledger gets the digest alone."""
    return Message(seq=seq, t_ms=t_ms, sha256=hashlib.sha256(data).hexdigest(), size=len(data))


def characters(message: Message) -> int:
    """What a message takes of an asset's value, at most."""
    return OVERHEAD_CHARACTERS + (0 if message.data is None else (len(message.data) + 2) // 3 * 4)


def topic_asset_id(prefix: str, bridge: str, topic: str) -> str:
    """The asset that holds a topic's latest messages; its history has the others."""
    return _bounded(f"{prefix}/{bridge}", topic)


def batch_asset_id(prefix: str, batch: Batch) -> str:
    """The asset of one batch: no restart and no lost spool leads to the same id again."""
    return _bounded(f"{prefix}/{batch.bridge}", batch.topic, f"#{batch.epoch}-{batch.batch:010d}")


def definition_asset_id(prefix: str, bridge: str, kind: str, type_hash: str) -> str:
    """The asset that holds a message type's definition."""
    return _bounded(f"{prefix}/{bridge}/definition", f"/{kind}", f"/{type_hash}")


def _bounded(before: str, name: str, after: str = "") -> str:
    """A name that is too long for an id is there by its digest."""
    whole = f"{before}{name}{after}"
    if len(whole) <= MAX_ID:
        return whole
    return f"{before}/~{hashlib.sha256(name.encode()).hexdigest()[:32]}{after}"
