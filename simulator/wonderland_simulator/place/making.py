"""Where the demo's archive is kept, and making it at most once at a time."""

from __future__ import annotations

import asyncio
import fcntl
import os
import sys
import tempfile
from pathlib import Path
from typing import Final

from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_simulator.place.archive import is_whole
from wonderland_simulator.place.build import build
from wonderland_simulator.place.fetch import FetchError, extract_into
from wonderland_simulator.place.osm import ExtractError

PLACE: Final = "monaco"
REVISION: Final = 2
"""Goes up with what is drawn into the archive, so that an older one is made anew."""


class PlaceError(Exception):
    """The archive cannot be made; the text says why, in one line."""


def cache_directory() -> Path:
    """Outside the working tree, by the XDG convention."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base.startswith("/") else Path.home() / ".cache") / "wonderland" / "place"


def archive_path() -> Path:
    """Where the archive is, or will be."""
    return cache_directory() / f"{PLACE}-{REVISION}.pmtiles"


def make(extract: Path | None = None) -> Path:
    """The archive, made unless it is there. ``extract``: an OSM PBF file to make it of. Raises `PlaceError`."""
    target = archive_path()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with (target.parent / ".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if extract is None and is_whole(target):
                return target
            _sweep(target)
            with tempfile.TemporaryDirectory(prefix="wonderland-place-") as name:
                build(extract or extract_into(Path(name)), target)
    except (FetchError, ExtractError, FileWriteError) as error:
        raise PlaceError(str(error)) from error
    except OSError as error:
        raise PlaceError(f"{error.filename or target.parent}: {error.strerror}") from error
    return target


def _sweep(target: Path) -> None:
    """What a making that was killed has left; the lock is ours, so that nobody writes it."""
    for left in target.parent.glob(f".{PLACE}-*"):
        left.unlink(missing_ok=True)


async def start_making() -> asyncio.subprocess.Process:
    """Make it in a process of its own, after everybody else's work; it ends by itself, its reason on stderr."""
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "wonderland_simulator.place",
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
