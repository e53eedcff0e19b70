"""A PMTiles archive on disk: what it is, whether a map can be drawn from it, and parts of it.

Only the header and the metadata are read, so that an archive of 50 GB costs what a small one does. Looked at anew as
soon as the file is another one: by its inode, size and time of change, which no copying program can set back.
"""

from __future__ import annotations

import gzip
import json
import os
import stat
import struct
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from wonderland import messages

HEADER_BYTES: Final = 127
MAX_METADATA: Final = 1 << 20
MAX_ATTRIBUTION: Final = 300
MAGIC: Final = b"PMTiles"
VERSION: Final = 3
NONE, GZIP = 1, 2
KINDS: Final = {1: "vector", 2: "png", 3: "jpeg", 4: "webp", 5: "avif"}
NEEDED: Final = frozenset({"earth", "water", "roads"})
"""Layers without which this is no base map that the console's style knows."""


Seen = tuple[int, int, int]
"""By what a file is known again: inode, size, time of change."""
SETTLING_NS: Final = 2_000_000_000
"""Times of change are as coarse as the kernel's clock: a file that changed just now may change again unseen."""


class MapError(Exception):
    """Why something cannot be shown, as a code of the catalogue `maps` with facts; as a text, for logs, English."""

    def __init__(self, code: str, **facts: str | int) -> None:
        super().__init__(messages.text("maps", code, facts))
        self.code = code
        self.facts = facts


class ArchiveError(MapError):
    """No map can be drawn from the file; nothing of it says its path."""


class ReplacedError(ArchiveError):
    """The file is another one than was asked for."""


@dataclass(frozen=True)
class Credit:
    """A piece of an attribution; ``href`` is an https:// address, or empty."""

    text: str
    href: str = ""


@dataclass(frozen=True)
class Description:
    """What an archive says of itself. Bounds are west, south, east, north in degrees."""

    tag: str
    changed_ns: int
    kind: str
    size_bytes: int
    bounds: tuple[float, float, float, float]
    min_zoom: int
    max_zoom: int
    layers: tuple[str, ...]
    attribution: tuple[Credit, ...]

    @property
    def settled(self) -> bool:
        """Whether its last change is so long ago that the next one will show."""
        return time.time_ns() - self.changed_ns > SETTLING_NS


class Archive:
    """One archive that a setting names; it may come, go and change while the server runs."""

    def __init__(self, path: Path, *, vector: bool) -> None:
        self._path = path
        self._vector = vector
        self._known: tuple[Seen, Description | ArchiveError] | None = None
        """Replaced as a whole: several threads read here."""

    def describe(self) -> Description:
        """What it is now. Raises `ArchiveError`. Blocks on the disk."""
        with self._opened() as file:
            return self._described(file)

    def part(self, first: int, length: int, tag: str) -> bytes:
        """Bytes of the file that has this tag. Raises `ArchiveError`. Blocks on the disk."""
        with self._opened() as file:
            self._described(file)
            if _tag(_seen(file)) != tag:
                raise ReplacedError("replaced")
            body = os.pread(file, length, first)
            # Overwritten in place, it may have become another one while it was read.
            if _tag(_seen(file)) != tag or len(body) != length:
                raise ReplacedError("replaced")
            return body

    @contextmanager
    def _opened(self) -> Iterator[int]:
        try:
            # Whoever opens a FIFO waits for its writer, for ever; that would hold up the server's start.
            file = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                if not stat.S_ISREG(os.fstat(file).st_mode):
                    raise ArchiveError("no_file")
                yield file
            finally:
                os.close(file)
        except OSError as cause:
            raise ArchiveError("unreadable", error=cause.strerror or "?") from None

    def _described(self, file: int) -> Description:
        seen = _seen(file)
        known = self._known
        if known is None or known[0] != seen:
            known = self._known = (seen, self._examined(file, seen))
        if isinstance(known[1], ArchiveError):
            raise known[1]
        return known[1]

    def _examined(self, file: int, seen: Seen) -> Description | ArchiveError:
        try:
            return _read(file, seen, vector=self._vector)
        except ArchiveError as error:
            return error


def _seen(file: int) -> Seen:
    status = os.fstat(file)
    return status.st_ino, status.st_size, status.st_ctime_ns


def _tag(seen: Seen) -> str:
    return "-".join(f"{each:x}" for each in seen)


def _read(file: int, seen: Seen, *, vector: bool) -> Description:
    size = seen[1]
    head = os.pread(file, HEADER_BYTES, 0)
    if head[:7] != MAGIC or len(head) < HEADER_BYTES or head[7] != VERSION:
        raise ArchiveError("no_pmtiles")
    root, root_length, words, words_length, leaves, leaves_length, tiles, tiles_length = struct.unpack_from(
        "<8Q", head, 8
    )
    for start, length in ((root, root_length), (words, words_length), (leaves, leaves_length), (tiles, tiles_length)):
        if start + length > size:
            raise ArchiveError("cut_off", size=size, needed=start + length)
    packing, tile_type, min_zoom, max_zoom = head[97], head[99], head[100], head[101]
    if packing not in {NONE, GZIP}:
        raise ArchiveError("packing")
    kind = KINDS.get(tile_type, "unknown")
    if (kind == "vector") is not vector or kind == "unknown":
        raise ArchiveError("kind", kind=kind, wanted="vector" if vector else "images")
    if vector and head[98] not in {NONE, GZIP}:
        raise ArchiveError("packing")
    west, south, east, north = (each / 1e7 for each in struct.unpack_from("<4i", head, 102))
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90 and min_zoom <= max_zoom <= 24):
        raise ArchiveError("bounds")
    metadata = _metadata(os.pread(file, min(words_length, MAX_METADATA), words), packing)
    layers = tuple(
        str(each["id"])[:64] for each in metadata.get("vector_layers") or [] if isinstance(each, dict) and "id" in each
    )
    if vector and not NEEDED.issubset(layers):
        raise ArchiveError("layers", layers=", ".join(sorted(NEEDED - set(layers))))
    return Description(
        tag=_tag(seen),
        changed_ns=seen[2],
        kind=kind,
        size_bytes=size,
        bounds=(west, south, east, north),
        min_zoom=min_zoom,
        max_zoom=max_zoom,
        layers=layers,
        attribution=credits_of(str(metadata.get("attribution") or "")),
    )


def _metadata(data: bytes, packing: int) -> dict[str, Any]:
    try:
        if packing == GZIP:
            data = zlib.decompressobj(wbits=31).decompress(data, MAX_METADATA)
        value = json.loads(data or b"{}")
    except (zlib.error, gzip.BadGzipFile, ValueError, RecursionError):
        raise ArchiveError("metadata") from None
    if not isinstance(value, dict):
        raise ArchiveError("metadata")
    return value


class _Credits(HTMLParser):
    """Takes text and links out of an attribution, which archives write as HTML; nothing else passes."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[Credit] = []
        self._href = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            href = dict(attrs).get("href") or ""
            self._href = href if urlsplit(href).scheme == "https" and len(href) <= MAX_ATTRIBUTION else ""

    def handle_endtag(self, tag: str) -> None:
        if tag == "a":
            self._href = ""

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.found.append(Credit(" ".join(data.split()), self._href))


def credits_of(html: str) -> tuple[Credit, ...]:
    """The pieces of an attribution: text, and links by https alone."""
    parser = _Credits()
    try:
        parser.feed(html[:MAX_ATTRIBUTION])
        parser.close()
    except ValueError:
        return (Credit(html[:MAX_ATTRIBUTION]),)
    return tuple(parser.found)
