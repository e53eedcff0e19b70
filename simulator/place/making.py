"""Where the demo's archive is kept, and making it at most once at a time."""

from __future__ import annotations

import asyncio
import fcntl
import os
import sys
import tempfile
from pathlib import Path
from typing import Final

from simulator.place.build import build
from simulator.place.fetch import FetchError, extract_into
from simulator.place.osm import ExtractError

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
    return cache_directory() / f"monaco-{REVISION}.pmtiles"


def make(extract: Path | None = None) -> Path:
    """The archive, made unless it is there. ``extract``: an OSM PBF file to make it of. Raises `PlaceError`."""
    target = archive_path()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with (target.parent / ".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if extract is None and target.is_file():
                return target
            with tempfile.TemporaryDirectory(prefix="wonderland-place-") as name:
                build(extract or extract_into(Path(name)), target)
    except (FetchError, ExtractError) as error:
        raise PlaceError(str(error)) from error
    except OSError as error:
        raise PlaceError(f"{error.filename or target.parent}: {error.strerror}") from error
    return target


async def start_making() -> asyncio.subprocess.Process:
    """Make it in a process of its own, after everybody else's work; it ends by itself, its reason on stderr."""
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "simulator.place",
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
