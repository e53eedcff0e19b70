"""Which messages of a topic go to the ledger, and how: all or a sample, whole or by digest. Pure."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

from msgspec import Meta

from wonderland.toml_settings import FieldError, Table
from wonderland_ros_bridge.ledger.envelope import Message, by_digest

NOT_BY_PATTERN: Final = ("/ledger/", "/rosout")
MAX_INLINE_BYTES: Final = 256 * 1024
"""In Base64 and with what stands around it, this fits into an asset (512 Ki characters)."""

Topic = Annotated[str, Meta(min_length=2, max_length=255, pattern=r"\A/[A-Za-z0-9_/]+\Z", examples=["/pose"])]


class Rule(Table, frozen=True):
    """``[[to_ledger]]``: topics, and what becomes of their messages."""

    topic: Annotated[
        str, Meta(min_length=2, max_length=255, pattern=r"\A/[A-Za-z0-9_/*?\[\]]+\Z", examples=["/pose", "/uav/*"])
    ]
    """A name, or a pattern (``/uav/*``): topics that fit are taken as they appear."""
    type: Annotated[str, Meta(pattern=r"\A[A-Za-z0-9_]+/(?:msg/)?[A-Za-z0-9_]+\Z")] | None = None
    """The only type that is taken; without it, any."""
    keep: Literal["latest", "each"] = "latest"
    """One asset for the topic, changed again and again, or one for each batch."""
    payload: Literal["whole", "digest"] = "whole"
    """What of a message goes to the ledger: all of it, or its SHA-256 alone."""
    inline_bytes: Annotated[int, Meta(ge=0, le=MAX_INLINE_BYTES)] = 64 * 1024
    """Larger messages go by their digest."""
    max_message_bytes: Annotated[int, Meta(ge=1, le=1 << 30)] = 16 << 20
    """A connection that announces a larger message is ended: it is not even read."""
    every: Annotated[int, Meta(ge=1, le=1_000_000)] = 1
    """One message of so many."""
    max_hz: Annotated[float, Meta(gt=0, le=10_000)] | None = None
    """Of one topic, messages more often than this are left out."""
    batch_messages: Annotated[int, Meta(ge=1, le=1_000)] = 100
    """Most messages in one transaction."""
    batch_bytes: Annotated[int, Meta(ge=1_024, le=MAX_INLINE_BYTES)] = 128 * 1024
    """Most octets in one transaction."""

    def __post_init__(self) -> None:
        """Names what does not go together."""
        if self.payload == "digest" and self.inline_bytes != 64 * 1024:
            raise FieldError('inline_bytes does not go with payload = "digest": every message goes by its digest')

    @property
    def is_pattern(self) -> bool:
        """Whether topics have to be looked for."""
        return any(letter in self.topic for letter in "*?[")

    def fits(self, topic: str) -> bool:
        """Whether this rule is about a topic.

        A pattern takes no topic of a bridge, unless it says so: two bridges at one master would feed each other.
        """
        return fnmatch.fnmatchcase(topic, self.topic) and (
            not self.is_pattern or not topic.startswith(NOT_BY_PATTERN) or self.topic.startswith(NOT_BY_PATTERN)
        )


def rule_of(topic: str, rules: Iterable[Rule]) -> Rule:
    """The first that fits. None may: of a former run, with other settings, what waits still goes."""
    return next((rule for rule in rules if rule.fits(topic)), Rule(topic=topic))


@dataclass(slots=True)
class Sampler:
    """A topic's sample: which messages go on. The time is given (ms), so that it can be tried."""

    rule: Rule
    _received: int = field(default=0)
    _due_ms: float = field(default=float("-inf"))

    def takes(self, t_ms: float) -> bool:
        """Whether the message that came now is in the sample."""
        index = self._received
        self._received += 1
        if index % self.rule.every:
            return False
        if self.rule.max_hz is None:
            return True
        if t_ms < self._due_ms:
            return False
        period_ms = 1_000 / self.rule.max_hz
        # From when it was due, not from when it came: else a topic of 10 Hz, sampled at 10 Hz, would lose half.
        self._due_ms = max(self._due_ms + period_ms, t_ms - period_ms / 2) if self._due_ms > 0 else t_ms + period_ms
        return True

    def message(self, seq: int, t_ms: int, data: bytes) -> Message:
        """The message as the ledger gets it."""
        if self.rule.payload == "digest" or len(data) > self.rule.inline_bytes:
            return by_digest(seq, t_ms, data)
        return Message(seq=seq, t_ms=t_ms, data=data)
