"""Secrets of an installation that nobody has to think of: the database's passwords, the token that opens /metrics."""

from __future__ import annotations

from base64 import urlsafe_b64encode
from collections.abc import Callable
from pathlib import Path
from typing import Final

from wonderland_fabric_gateway.files import write_atomic

BYTES: Final = 32
FOR_SERVER: Final = "password"
FOR_CLIENT: Final = "pgpass"
METRICS_TOKEN: Final = "metrics-token"  # noqa: S105 - a file name
WEBHOOK_KEY: Final = "webhook.key"
_GROUP: Final = 0o640


def ensure_file(path: Path, fresh: bytes) -> None:
    """Write a secret of the server where there is none. Raises `FileWriteError`, OSError."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o750)
    if not path.exists():
        write_atomic(path, fresh, _GROUP)


def new_key(randomness: Callable[[int], bytes]) -> bytes:
    """A line of a file of keys that encrypt: base64 of 32 bytes."""
    return urlsafe_b64encode(randomness(BYTES)) + b"\n"


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
