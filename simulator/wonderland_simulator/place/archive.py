"""PMTiles, version 3: one file with all tiles of a map, which a browser reads by byte ranges.

The format is public (github.com/protomaps/PMTiles, spec/v3): a header of 127 bytes, a directory, metadata, tiles.
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from wonderland_fabric_gateway.files import write_atomic

Tile = tuple[int, int, int]
"""Zoom, column, row."""
MAGIC: Final = b"PMTiles\x03"
HEADER_BYTES: Final = 127
_GZIP: Final = 2
_VECTOR: Final = 1
MAX_ROOT: Final = 16_384 - HEADER_BYTES
"""A reader fetches the header and the first directory with its first 16 kB."""


def tile_id(tile: Tile) -> int:
    """The tile's number: zoom by zoom, along a Hilbert curve in each."""
    zoom, x, y = tile
    number = ((1 << (2 * zoom)) - 1) // 3
    side = 1 << zoom
    half = side // 2
    while half > 0:
        right, down = int(x & half > 0), int(y & half > 0)
        number += half * half * ((3 * right) ^ down)
        if down == 0:
            if right == 1:
                x, y = side - 1 - x, side - 1 - y
            x, y = y, x
        half //= 2
    return number


def _varint(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def directory(entries: Sequence[tuple[int, int, int]]) -> bytes:
    """Entries of (tile number, offset, length) as a reader expects them, packed; sorted by number."""
    out = bytearray(_varint(len(entries)))
    last = 0
    for number, _, _ in entries:
        out += _varint(number - last)
        last = number
    out += b"\x01" * len(entries)
    for _, _, length in entries:
        out += _varint(length)
    end = None
    for _, offset, length in entries:
        out += _varint(0 if offset == end else offset + 1)
        end = offset + length
    return gzip.compress(bytes(out), mtime=0)


def write(
    path: Path,
    tiles: Mapping[Tile, bytes],
    metadata: Mapping[str, Any],
    bounds: tuple[float, float, float, float],
) -> int:
    """Write gzipped vector tiles as one archive; returns its bytes. ``bounds``: west, south, east, north, degrees."""
    data = bytearray()
    known: dict[bytes, int] = {}
    entries = []
    for tile in sorted(tiles, key=tile_id):
        content = tiles[tile]
        if content not in known:
            known[content] = len(data)
            data += content
        entries.append((tile_id(tile), known[content], len(content)))
    root = directory(entries)
    if len(root) > MAX_ROOT:
        raise ValueError(f"{len(entries)} tiles need a second level of directories, which this writer does not make")
    words = gzip.compress(json.dumps(metadata, ensure_ascii=False, sort_keys=True).encode(), mtime=0)
    after_root = HEADER_BYTES + len(root)
    start = after_root + len(words)
    zooms = [zoom for zoom, _, _ in tiles]
    west, south, east, north = (round(each * 1e7) for each in bounds)
    header = MAGIC + struct.pack("<8Q", HEADER_BYTES, len(root), after_root, len(words), start, 0, start, len(data))
    header += struct.pack("<3Q", len(entries), len(entries), len(known))
    header += bytes([1, _GZIP, _GZIP, _VECTOR, min(zooms), max(zooms)])
    header += struct.pack("<4i", west, south, east, north)
    header += struct.pack("<B2i", min(zooms), (west + east) // 2, (south + north) // 2)
    assert len(header) == HEADER_BYTES
    whole = header + root + words + bytes(data)
    write_atomic(path, whole)
    return len(whole)


def is_whole(path: Path) -> bool:
    """Whether there is an archive of this writer's, to its last byte."""
    try:
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
            size = file.seek(0, 2)
    except OSError:
        return False
    if len(head) < HEADER_BYTES or not head.startswith(MAGIC):
        return False
    start, length = struct.unpack_from("<2Q", head, 56)
    return bool(start + length == size)
