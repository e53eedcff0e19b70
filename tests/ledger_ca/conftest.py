"""A CA whose time stands still until a test moves it."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime, timedelta

import pytest

from wonderland_fabric_gateway.ca import LocalCa


class Clock:
    def __init__(self) -> None:
        self.moment = datetime(2026, 3, 1, 12, 0, 0, 400_000, tzinfo=UTC)

    def __call__(self) -> datetime:
        return self.moment

    def advance(self, **by: float) -> None:
        self.moment += timedelta(**by)


class CountedBytes:
    """Repeatable "randomness": each call gives other bytes."""

    def __init__(self) -> None:
        self._counter = itertools.count(1)

    def __call__(self, length: int) -> bytes:
        return (b"%064d" % next(self._counter))[-length:].rjust(length, b"\x55")


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def random_bytes():
    return CountedBytes()


@pytest.fixture
def ca(tmp_path, clock, random_bytes):
    return LocalCa.create(tmp_path / "ca", "PadMSP", now=clock, random_bytes=random_bytes)
