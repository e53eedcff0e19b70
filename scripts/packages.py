"""Installs Python packages into the environment that runs this, by uv: ``python scripts/packages.py ARGUMENTS…``.

uv asks the index that pip is told of, by its configuration or the environment, and trusts the certificates that this
system trusts. It needs nothing but pip and uv themselves.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def index() -> str | None:
    """The index that pip is told of; None for the usual one."""
    for place in (":env:", "install", "global"):
        command = [sys.executable, "-m", "pip", "config", "get", f"{place}.index-url"]
        if told := subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip():
            return told.rstrip("/")
    return None


def main(arguments: list[str]) -> int:
    """Install; uv's exit code."""
    told = index()
    environment = os.environ | {"UV_SYSTEM_CERTS": "1"} | ({} if told is None else {"UV_DEFAULT_INDEX": told})
    command = [Path(sys.executable).with_name("uv"), "pip", "install", "--quiet", "--python", sys.executable]
    return subprocess.run([*command, *arguments], env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
