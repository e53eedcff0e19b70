"""Work with a pad's nodes while its agent does not."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from wonderland_edge_agent.commissioning.errors import RadioError
from wonderland_edge_agent.spool.errors import SpoolError
from wonderland_edge_agent.spool.lock import LOCK_NAME, ProcessLock


@contextlib.contextmanager
def alone(spool: Path) -> Iterator[None]:
    """No agent of this pad runs meanwhile: it would hold the nodes. Raises RadioError where one does."""
    try:
        spool.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = ProcessLock(spool / LOCK_NAME)
    except (OSError, SpoolError) as error:
        raise RadioError(f"the pad's agent seems to run; stop it while commissioning ({error})") from error
    try:
        yield
    finally:
        lock.release()
