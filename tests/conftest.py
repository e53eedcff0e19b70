"""The fixtures that several folders share come from the kit; what is one folder's own stands in that folder."""

from __future__ import annotations

import gc
import os
import signal
from pathlib import Path

# Before numpy: its matrices here are small, and threads that share them wait for one another at full speed.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

# How long an example takes says more of the machine, and of who else is on it, than of the code.
settings.register_profile("crowded", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("crowded")

pytest.register_assert_rewrite("kit")

TESTS = Path(__file__).parent

pytest_plugins = [
    "kit.backend",
    "kit.browser",
    "kit.chain",
    "kit.console",
    "kit.databases",
    "kit.facts",
    "kit.houses",
    "kit.outages",
    "kit.postgres",
    "kit.routes",
]

LONGEST_FIRST = (
    "system",
    "network",
    "scenarios",
    "evidence",
    "console",
    "simulator",
    "registry",
    "people",
    "backend",
    "api",
)
"""Folders of tests that take long: with them first, all workers come to their end at about the same time."""

TOGETHER = ("evidence", "network", "scenarios")
"""Folders that stay with one worker: their networks of Fabric are brought up once."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        """A worker takes a file, or a whole folder of those."""

        def _split_scope(self, nodeid):
            folder = Path(nodeid).parts[1]
            return folder if folder in TOGETHER else super()._split_scope(nodeid)

    return Scheduling(config, log)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    order = {name: rank for rank, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: order.get(item.path.relative_to(TESTS).parts[0], len(order)))


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown():
    """Processes inherit which signals are held: after a test that leaves some so, later ones could not be ended."""
    left = signal.pthread_sigmask(signal.SIG_SETMASK, ())
    assert not left, f"left held: {left}"


gc.set_threshold(20_000, 20, 50)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """What was imported lives as long as the run: a collector that keeps looking through it costs a fifth of the time."""
    gc.collect()
    gc.freeze()
