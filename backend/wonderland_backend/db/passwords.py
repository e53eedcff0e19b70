"""Secrets of an installation that nobody has to think of: the database's password, the token that opens /metrics."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from wonderland_fabric_gateway.files import write_atomic

BYTES: Final = 32
FOR_SERVER: Final = "password"
FOR_CLIENT: Final = "pgpass"
METRICS_TOKEN: Final = "metrics-token"  # noqa: S105 - a file name
_GROUP: Final = 0o640


def ensure_token(directory: Path, fresh: str) -> None:
    """Write `fresh` as the token of /metrics where there is none. Raises `FileWriteError`, OSError."""
    directory.mkdir(parents=True, exist_ok=True, mode=0o750)
    path = directory / METRICS_TOKEN
    if not path.exists():
        write_atomic(path, f"{fresh}\n".encode(), _GROUP)


def ensure(directory: Path, user: str, fresh: str) -> bool:
    """Write `fresh` to a directory without a password; whether it did. Raises `FileWriteError`, OSError.

    ``password`` may be read by the directory's group, to which the server belongs; ``pgpass`` by its owner only, since
    libpq takes no other.
    """
    directory.mkdir(parents=True, exist_ok=True, mode=0o750)
    server, client = directory / FOR_SERVER, directory / FOR_CLIENT
    made = not server.exists()
    password = fresh if made else server.read_text().strip()
    if made:
        write_atomic(server, f"{password}\n".encode(), _GROUP)
    if made or not client.exists():
        write_atomic(client, f"*:*:*:{user}:{password}\n".encode())
    return made
