"""What one worker makes serves all workers of a run."""

from __future__ import annotations

import fcntl
import os


def made_once(factory, name, make):
    """The directory of that name, which ``make(directory)`` fills; whoever comes meanwhile waits for it.

    ``factory`` is pytest's `tmp_path_factory`. Nobody may write there afterwards.
    """
    own = factory.getbasetemp()
    shared = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    made = shared / name
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            unfinished = shared / f"{name}.unfinished"
            make(unfinished)
            unfinished.rename(made)
    return made
