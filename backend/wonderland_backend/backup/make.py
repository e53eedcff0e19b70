"""Making a backup: a directory that has its name only when it is whole, readable by its owner."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from sqlalchemy.engine import URL

from wonderland import __version__
from wonderland_backend.backup import postgres, sealed, sqlite
from wonderland_backend.backup.manifest import DATABASE, FORMAT, NAME, SEALED, Manifest, file_of
from wonderland_backend.errors import BackendError
from wonderland_fabric_gateway.files import sync_directory, write_atomic

PREFIX: Final = "wonderland-"
_NAMED: Final = re.compile(PREFIX + r"\d{8}T\d{9}Z")
_PARTIAL: Final = ".partial"


def make(
    url: URL,
    revision: str,
    to: Path,
    now_ms: int,
    *,
    keep: int | None = None,
    also: Sequence[Path] = (),
    passphrase: bytes | None = None,
    randomness: Callable[[int], bytes],
) -> Path:
    """The new backup's directory in `to`; beyond `keep` the oldest ones go. Raises `BackendError`, OSError."""
    moment = datetime.fromtimestamp(now_ms / 1000, UTC)
    final = to / f"{PREFIX}{moment:%Y%m%dT%H%M%S}{now_ms % 1000:03}Z"
    to.mkdir(parents=True, exist_ok=True, mode=0o700)
    with _alone(to), _partial(to, final) as directory:
        tables: dict[str, tuple[int, str]] = {}
        role = ""
        if url.get_backend_name() == "sqlite":
            sqlite.copy(Path(url.database or ""), directory / DATABASE)
        else:
            tables, role = postgres.dump(url, directory / DATABASE)
        plain, databases = sealed.sorted_out(also)
        files = {DATABASE: file_of(directory / DATABASE)}
        for number, path in enumerate(databases):
            name = f"also-{number}.sqlite3"
            sqlite.copy(path, directory / name)
            files[name] = file_of(directory / name, str(path))
        manifest = Manifest(
            format=FORMAT,
            version=__version__,
            made_ms=now_ms,
            database="sqlite" if url.get_backend_name() == "sqlite" else "postgresql",
            revision=revision,
            files=files,
            tables=tables,
            server_role=role,
            salt=b"" if passphrase is None else randomness(sealed.SALT_BYTES),
        )
        if passphrase is not None:
            nonce = randomness(sealed.NONCE_BYTES)
            data = sealed.seal(plain, passphrase, manifest.salt, nonce, manifest.bound())
            write_atomic(directory / SEALED, data)
            manifest.files[SEALED] = file_of(directory / SEALED)
        for name in files:
            _sync(directory / name)
        write_atomic(directory / NAME, manifest.encode())
    if keep is not None:
        for old in backups(to)[:-keep]:
            shutil.rmtree(old)
    return final


def backups(to: Path) -> list[Path]:
    """Those that are whole, the oldest first."""
    return sorted(each for each in to.iterdir() if _NAMED.fullmatch(each.name) and (each / NAME).is_file())


@contextlib.contextmanager
def _alone(to: Path) -> Iterator[None]:
    handle = os.open(to / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise BackendError(f"another backup is being made in {to}; wait for it") from None
    finally:
        os.close(handle)


@contextlib.contextmanager
def _partial(to: Path, final: Path) -> Iterator[Path]:
    """A directory that becomes `final` when all went well; what killed ones left goes first."""
    for left in to.glob(f"{PREFIX}*{_PARTIAL}"):
        shutil.rmtree(left)
    directory = final.with_name(final.name + _PARTIAL)
    directory.mkdir(mode=0o700)
    try:
        yield directory
        directory.rename(final)
        sync_directory(to)
    except BaseException:
        shutil.rmtree(directory, ignore_errors=True)
        raise


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
