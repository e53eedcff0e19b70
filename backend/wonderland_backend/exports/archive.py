"""An archive written as it is sent: files in pieces, and last the manifest that says what they are."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import AsyncIterator, Callable
from datetime import UTC, datetime
from typing import Any

import orjson

from wonderland_backend.exports.formats import File


class _Outgoing(io.RawIOBase):
    """What the archive writes until it is taken; it cannot go back."""

    def __init__(self) -> None:
        super().__init__()
        self._pieces: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any, /) -> int:
        self._pieces.append(bytes(data))
        return len(data)

    def take_bytes(self) -> bytes:
        pieces, self._pieces = self._pieces, []
        return b"".join(pieces)


async def archive(
    files: list[File], manifest: Callable[[list[dict[str, Any]]], dict[str, Any]], now_ms: int
) -> AsyncIterator[bytes]:
    """The archive in pieces. `manifest` is asked at the end, with name, size and SHA-256 of each file."""
    outgoing = _Outgoing()
    stamp = datetime.fromtimestamp(now_ms / 1000, UTC).timetuple()[:6]
    written: list[dict[str, Any]] = []
    with zipfile.ZipFile(outgoing, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as packed:
        for file in files:
            digest = hashlib.sha256()
            size = 0
            with packed.open(_entry(file.name, stamp), "w", force_zip64=True) as entry:
                async for piece in file.content:
                    data = piece.encode()
                    digest.update(data)
                    size += len(data)
                    entry.write(data)
                    ready = outgoing.take_bytes()
                    if ready:
                        yield ready
            written.append({"name": file.name, "bytes": size, "sha256": digest.hexdigest()})
        content = orjson.dumps(manifest(written), option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
        packed.writestr(_entry("manifest.json", stamp), content)
    yield outgoing.take_bytes()


def _entry(name: str, stamp: Any) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, stamp)
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    return info
