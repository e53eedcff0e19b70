"""Settings, keys and certificates: one archive under a passphrase (scrypt, AES-256-GCM)."""

from __future__ import annotations

import io
import json
import os
import shutil
import tarfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.scrypt import Scrypt
from pydantic import BaseModel

from wonderland_backend.errors import BackendError

SALT_BYTES: Final = 16
NONCE_BYTES: Final = 12
MIN_PASSPHRASE: Final = 12
MAX_ARCHIVE_BYTES: Final = 256 << 20
SQLITE: Final = b"SQLite format 3\0"
_LEFT: Final = ("-wal", "-shm", "-journal", ".lock")


def passphrase_in(path: Path) -> bytes:
    """The first line of a file. Raises `BackendError`."""
    try:
        with path.open("rb") as file:
            found = file.readline(4096).strip()
    except OSError as error:
        raise BackendError(f"--passphrase-file: {error}") from error
    if len(found) < MIN_PASSPHRASE:
        raise BackendError(f"--passphrase-file: {path}: {MIN_PASSPHRASE} characters at least")
    return found


def _key(passphrase: bytes, salt: bytes) -> bytes:
    # 128 MiB and about half a second for each guess.
    return Scrypt(salt, length=32, n=1 << 17, r=8, p=1).derive(passphrase)


def named_files(settings: BaseModel) -> Iterator[Path]:
    """Every file that settings name and that is there, with what connection.json names in turn."""
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        if isinstance(value, BaseModel):
            yield from named_files(value)
        elif isinstance(value, Path) and value.is_file():
            yield value
            if name == "connection":
                yield from _named_in(value)


def _named_in(connection: Path) -> Iterator[Path]:
    try:
        waiting = [json.loads(connection.read_text())]
    except (OSError, ValueError) as error:
        raise BackendError(f"{connection} cannot be read: {error}") from error
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            waiting += one.values()
        elif isinstance(one, list):
            waiting += one
        elif isinstance(one, str) and 0 < len(one) < 4096 and (path := connection.parent / one).is_file():
            yield path


def sorted_out(paths: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Plain files, and SQLite databases, of these files and directories; each once, by absolute path."""
    plain, databases = set[Path](), set[Path]()
    for given in paths:
        for path in [given] if given.is_file() else given.rglob("*"):
            if path.is_file() and not path.name.endswith(_LEFT):
                with path.open("rb") as file:
                    (databases if file.read(len(SQLITE)) == SQLITE else plain).add(path.absolute())
    return sorted(plain), sorted(databases)


def seal(files: Iterable[Path], passphrase: bytes, salt: bytes, nonce: bytes, bound: bytes) -> bytes:
    """The archive; it opens beside the same manifest only. Raises `BackendError`, OSError."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for path in files:
            archive.add(path.resolve(), arcname=str(path).lstrip("/"), recursive=False)
            if packed.tell() > MAX_ARCHIVE_BYTES:
                raise BackendError(f"--also: more than {MAX_ARCHIVE_BYTES >> 20} MiB of files that are no database")
    return nonce + AESGCM(_key(passphrase, salt)).encrypt(nonce, packed.getvalue(), bound)


def unseal(data: bytes, passphrase: bytes, salt: bytes, bound: bytes) -> bytes:
    """The archive. Raises `BackendError`."""
    try:
        return AESGCM(_key(passphrase, salt)).decrypt(data[:NONCE_BYTES], data[NONCE_BYTES:], bound)
    except (InvalidTag, ValueError):
        raise BackendError("--passphrase-file: another passphrase, or an altered manifest") from None


def unpack(archive: bytes, to: Path) -> list[Path]:
    """Put the files below a directory, with their modes and, as root, their owners. What is there is never replaced."""
    with tarfile.open(fileobj=io.BytesIO(archive)) as packed:
        members = packed.getmembers()
        for each in members:
            if not each.isreg() or each.name.startswith("/") or ".." in Path(each.name).parts:
                raise BackendError(f"{each.name} in the backup is no file, or leads elsewhere; nothing is written")
            refuse_existing(to / each.name)
        for each in members:
            _write(packed, each, to / each.name)
    return [to / each.name for each in members]


def _write(packed: tarfile.TarFile, member: tarfile.TarInfo, path: Path) -> None:
    # Python 3.11.2, which is Debian 12's, has no filter for `extractall`, and later ones ask for one.
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    source = packed.extractfile(member)
    assert source is not None  # a regular file
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    with source, os.fdopen(handle, "wb") as file:
        shutil.copyfileobj(source, file)
    path.chmod(member.mode & 0o755)
    if os.geteuid() == 0:
        try:
            shutil.chown(path, member.uname or member.uid, member.gname or member.gid)
        except LookupError:  # another machine, which knows no such user
            os.chown(path, member.uid, member.gid)


def refuse_existing(path: Path) -> None:
    """Raises `BackendError` where there is something already."""
    if path.exists() or path.is_symlink():
        raise BackendError(f"{path} is there already: move it away, or take another --files-to; nothing is written")
