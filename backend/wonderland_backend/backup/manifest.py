"""What a backup says of itself; a cut, altered or foreign one is refused before anything is changed."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Final, Literal

import msgspec

from wonderland_backend.errors import BackendError

FORMAT: Final = "wonderland-backup-1"
NAME: Final = "manifest.json"
DATABASE: Final = "database"
SEALED: Final = "files.sealed"
MAX_BYTES: Final = 1 << 22
_PLAIN: Final = re.compile(r"[a-z0-9][a-z0-9.-]{0,99}")


class File(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A file of the backup; `path`: where a SQLite file beside the database came from."""

    bytes: int
    sha256: str
    path: str = ""


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """`tables`: rows and digest by table, on PostgreSQL; `server_role`: as which the server connects there."""

    format: str
    version: str
    made_ms: int
    database: Literal["sqlite", "postgresql"]
    revision: str
    files: dict[str, File]
    tables: dict[str, tuple[int, str]] = {}
    server_role: str = ""
    salt: bytes = b""
    """Of the passphrase, where files are sealed."""

    def encode(self) -> bytes:
        """As it stands in the backup."""
        return msgspec.json.format(msgspec.json.encode(self, order="sorted"), indent=1) + b"\n"

    def bound(self) -> bytes:
        """What the sealed files are bound to: all of the manifest but their own line."""
        rest = {name: each for name, each in self.files.items() if name != SEALED}
        return msgspec.structs.replace(self, files=rest).encode()


class _Format(msgspec.Struct):
    format: str


class _Moment(msgspec.Struct):
    made_ms: int


def moment_ms(directory: Path) -> int | None:
    """When a backup was made (Unix), by its manifest alone; None where that cannot be read."""
    try:
        return msgspec.json.decode((directory / NAME).read_bytes(), type=_Moment).made_ms
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None


def file_of(path: Path, came_from: str = "") -> File:
    """Its size and SHA-256. Raises OSError."""
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        return File(file.tell(), sha256, came_from)


def read(directory: Path) -> Manifest:
    """The manifest, when every file is what it says. Raises `BackendError`."""
    try:
        with (directory / NAME).open("rb") as file:
            data = file.read(MAX_BYTES)
    except FileNotFoundError:
        raise BackendError(f"{directory} is no backup, or one that was not finished: it has no {NAME}") from None
    except OSError as error:
        raise BackendError(f"{directory}: {error}") from error
    try:
        stated = msgspec.json.decode(data, type=_Format).format
        if stated != FORMAT:
            raise BackendError(f"{directory} has the format {stated[:40]!r}; this version of Wonderland reads {FORMAT}")
        found = msgspec.json.decode(data, type=Manifest)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise BackendError(f"{directory / NAME} is cut, altered or no manifest: {error}") from None
    if DATABASE not in found.files:
        raise BackendError(f"{directory / NAME} names no {DATABASE}")
    for name, stated_file in found.files.items():
        _compare(directory, name, stated_file)
    return found


def _compare(directory: Path, name: str, stated: File) -> None:
    path = directory / name
    if not _PLAIN.fullmatch(name) or path.is_symlink() or not path.is_file():
        raise BackendError(f"{directory}: {name[:100]} is missing, or no file of a backup")
    try:
        found = file_of(path, stated.path)
    except OSError as error:
        raise BackendError(f"{path} cannot be read: {error.strerror}") from error
    if found.bytes != stated.bytes:
        raise BackendError(f"{path} has {found.bytes} bytes, and {stated.bytes} are its: it was cut")
    if found.sha256 != stated.sha256:
        raise BackendError(f"{path} was altered: its SHA-256 is another")
