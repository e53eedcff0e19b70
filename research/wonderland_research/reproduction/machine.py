"""On what a report was made: versions, processor, time."""

from __future__ import annotations

import datetime as dt
import os
import platform
from importlib import metadata
from pathlib import Path

PACKAGES = ("numpy", "scipy", "matplotlib", "cryptography", "grpcio")


def facts() -> list[tuple[str, str]]:
    """Name and value of each, for the head of a report."""
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    now = dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return [
        ("Made", now),
        (
            "Software",
            f"wonderland {metadata.version('wonderland-core')}, Python {platform.python_version()}, {versions}",
        ),
        ("Machine", f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}"),
    ]


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"
