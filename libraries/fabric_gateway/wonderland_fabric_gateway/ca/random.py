"""Where randomness comes from: a function, so that tests can be repeated."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

RandomBytes: TypeAlias = Callable[[int], bytes]
"""n → n unpredictable bytes, `os.urandom` outside tests."""
