"""Whoever has a part in the mirror's commits: in the database transaction, and once it is committed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.mirror.derive import Changes

T = TypeVar("T")


class Subscriber(ABC, Generic[T]):
    """Two moments of a commit. What the first finds is handed to the second, which comes only if the commit did."""

    @abstractmethod
    async def in_transaction(self, connection: AsyncConnection, changes: Changes) -> T:
        """Within the database transaction, which sees the rows that were just written. Nothing is told yet."""

    @abstractmethod
    def after_commit(self, changes: Changes, found: T) -> None:
        """What was written stands: tell of it."""


class AfterCommit(Subscriber[None]):
    """Somebody who is told of commits and writes nothing."""

    def __init__(self, tell: Callable[[Changes], None]) -> None:
        self._tell = tell

    async def in_transaction(self, connection: AsyncConnection, changes: Changes) -> None:
        """Takes no part in the transaction."""

    def after_commit(self, changes: Changes, found: None) -> None:  # noqa: ARG002
        """Told once the block is committed."""
        self._tell(changes)
