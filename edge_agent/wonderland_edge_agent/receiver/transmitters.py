"""Who sends, and how much of it is taken: no flood may displace or starve those who were there before it."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from wonderland_edge_agent.receiver.limits import ReceiverLimits, TokenBucket

if TYPE_CHECKING:
    from wonderland_remote_id import IdType

ESTABLISHED_MS: Final = 1_000
"""A transmitter that is heard again after this is no newcomer."""


class Source:
    """What one transmitter, or one relay, has said about itself."""

    __slots__ = ("bucket", "first_ms", "identities", "modest")

    def __init__(self, limits: ReceiverLimits, now_ms: int) -> None:
        self.bucket = TokenBucket(limits.frames_per_source_s, limits.frames_per_source_s, now_ms)
        self.modest = TokenBucket(limits.modest_per_s, limits.modest_per_s, now_ms)
        self.first_ms = now_ms
        self.identities: dict[tuple[IdType, str], int] = {}


class Sources:
    """All of them, bounded in number and in the frames that are taken of them.

    Who sends under ever new addresses displaces newcomers only, and shares their part of the frames.
    """

    def __init__(self, limits: ReceiverLimits, now_ms: int) -> None:
        self._limits = limits
        self._known: OrderedDict[str, Source] = OrderedDict()
        self._newcomers: OrderedDict[str, Source] = OrderedDict()
        self._all = TokenBucket(limits.frames_per_s, limits.frames_per_s, now_ms)
        self._reserved = TokenBucket(limits.reserved_per_s, limits.reserved_per_s, now_ms)

    def admit(self, name: str, now_ms: int) -> Source | None:
        """The sender of a frame; None where that frame is one too many."""
        source = self._source(name, now_ms)
        if not source.bucket.take_token(now_ms):
            return None
        if name in self._known and source.modest.take_token(now_ms) and self._reserved.take_token(now_ms):
            return source
        return source if self._all.take_token(now_ms) else None

    def _source(self, name: str, now_ms: int) -> Source:
        if name in self._known:
            self._known.move_to_end(name)
            return self._known[name]
        source = self._newcomers.pop(name, None) or Source(self._limits, now_ms)
        if now_ms - source.first_ms >= ESTABLISHED_MS:
            self._keep(self._known, name, source, self._limits.sources)
        else:
            self._keep(self._newcomers, name, source, self._limits.newcomers)
        return source

    @staticmethod
    def _keep(where: OrderedDict[str, Source], name: str, source: Source, most: int) -> None:
        where[name] = source
        if len(where) > most:
            where.popitem(last=False)
