"""How many event streams (SSE) are open: of all, and of each person or machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

from wonderland.problems import said
from wonderland_backend.context import part
from wonderland_backend.errors import TooManyRequests


class Streams:
    """Counts them, in this process."""

    def __init__(self, most: int, most_each: int) -> None:
        self._most = most
        self._most_each = most_each
        self._open: Counter[str] = Counter()

    @property
    def count(self) -> int:
        """Streams that are open now, of everybody."""
        return self._open.total()

    def check(self, person_id: str) -> None:
        """Whether one more may be opened. Raises `TooManyRequests`."""
        if self._open[person_id] >= self._most_each:
            raise TooManyRequests(said("too_many_streams", most=self._most_each))
        if self.count >= self._most:
            raise TooManyRequests(said("streams_busy"))

    @contextmanager
    def held(self, person_id: str) -> Iterator[None]:
        """Count one as long as it is open."""
        self._open[person_id] += 1
        try:
            yield
        finally:
            self._open[person_id] -= 1
            if not self._open[person_id]:
                del self._open[person_id]


StreamsDep = Annotated[Streams, part(Streams)]
