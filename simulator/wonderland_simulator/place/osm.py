"""OpenStreetMap's PBF format: nodes, ways and relations of a small extract, all in memory.

The format is protobuf in zlib blocks, documented at wiki.openstreetmap.org/wiki/PBF_Format. A reader of our own, since
an extract of a town needs no library of 5 MB (docs/decisions/0020).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

MAX_FILE: Final = 64 << 20
MAX_BLOCK: Final = 32 << 20
"""What the format allows for one block, unpacked, bytes."""
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5

Tags = dict[str, str]
LonLat = tuple[float, float]
"""Longitude and latitude, degrees."""


class ExtractError(Exception):
    """The extract cannot be read; the text says why."""


@dataclass(frozen=True)
class Way:
    """A line through nodes; closed ones may be areas."""

    id: int
    nodes: tuple[int, ...]
    tags: Tags


@dataclass(frozen=True)
class Relation:
    """Members as (type, id, role): type 0 is a node, 1 a way, 2 a relation."""

    id: int
    members: tuple[tuple[int, int, str], ...]
    tags: Tags


@dataclass
class Extract:
    """Everything of an extract; ``marked`` are the nodes that have tags."""

    places: dict[int, LonLat] = field(default_factory=dict)
    marked: dict[int, Tags] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: dict[int, Relation] = field(default_factory=dict)

    def line(self, way: Way) -> list[LonLat]:
        """Its nodes' places, as far as the extract has them."""
        return [self.places[node] for node in way.nodes if node in self.places]


def read(data: bytes) -> Extract:
    """The whole extract. Raises `ExtractError`."""
    if len(data) > MAX_FILE:
        raise ExtractError(f"the extract has {len(data) >> 20} MB; this reader takes {MAX_FILE >> 20} MB at most")
    extract = Extract()
    try:
        for kind, block in _blocks(data):
            if kind == "OSMData":
                _read_block(block, extract)
    except (IndexError, struct.error, zlib.error, UnicodeDecodeError) as cause:
        raise ExtractError(f"this is no OpenStreetMap PBF file, or a damaged one ({cause})") from cause
    return extract


def _blocks(data: bytes) -> Iterator[tuple[str, bytes]]:
    at = 0
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        header = _fields(data[at + 4 : at + 4 + length])
        at += 4 + length
        size = _int(header, 3)
        if length > 1 << 16 or size > MAX_BLOCK or at + size > len(data):
            raise ExtractError("the extract ends in the middle of a block, or is no OpenStreetMap PBF file")
        blob = _fields(data[at : at + size])
        at += size
        packed = _bytes(blob, 3)
        unpacker = zlib.decompressobj()
        yield _bytes(header, 1).decode(), _bytes(blob, 1) or unpacker.decompress(packed, MAX_BLOCK)


def _read_block(data: bytes, extract: Extract) -> None:
    block = _fields(data)
    strings = [bytes(each).decode() for each in _fields(_bytes(block, 1)).get(1, []) if isinstance(each, bytes)]
    step = (_int(block, 17) or 100) * 1e-9
    north, east = _int(block, 19) * 1e-9, _int(block, 20) * 1e-9
    for group in block.get(2, []):
        assert isinstance(group, bytes)
        parts = _fields(group)
        for dense in parts.get(2, []):
            assert isinstance(dense, bytes)
            _read_nodes(_fields(dense), extract, strings, (step, east, north))
        for each in parts.get(3, []):
            assert isinstance(each, bytes)
            way = _fields(each)
            nodes = tuple(_summed(_packed(_bytes(way, 8))))
            number = _int(way, 1)
            extract.ways[number] = Way(number, nodes, _tags(way, strings))
        for each in parts.get(4, []):
            assert isinstance(each, bytes)
            relation = _fields(each)
            number = _int(relation, 1)
            roles = (strings[role] for role in _packed(_bytes(relation, 8)))
            members = zip(_packed(_bytes(relation, 10)), _summed(_packed(_bytes(relation, 9))), roles, strict=True)
            extract.relations[number] = Relation(number, tuple(members), _tags(relation, strings))


def _read_nodes(dense: Fields, extract: Extract, strings: list[str], scale: tuple[float, float, float]) -> None:
    step, east, north = scale
    numbers = list(_summed(_packed(_bytes(dense, 1))))
    lats, lons = _summed(_packed(_bytes(dense, 8))), _summed(_packed(_bytes(dense, 9)))
    words = iter(_packed(_bytes(dense, 10)))
    for number, lat, lon in zip(numbers, lats, lons, strict=True):
        extract.places[number] = (east + step * lon, north + step * lat)
        tags: Tags = {}
        while (key := next(words, 0)) != 0:
            tags[strings[key]] = strings[next(words)]
        if tags:
            extract.marked[number] = tags


def _tags(fields: Fields, strings: list[str]) -> Tags:
    keys, values = _packed(_bytes(fields, 2)), _packed(_bytes(fields, 3))
    return {strings[key]: strings[value] for key, value in zip(keys, values, strict=True)}


Fields = dict[int, list[int | bytes]]
"""A protobuf message: field number → what stands there, as often as it does."""


def _fields(data: bytes) -> Fields:
    result: Fields = {}
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        kind = key & 7
        value: int | bytes
        if kind == _VARINT:
            value, at = _varint(data, at)
        else:
            if kind == _BYTES:
                size, at = _varint(data, at)
            elif kind in {_FIXED64, _FIXED32}:
                size = 8 if kind == _FIXED64 else 4
            else:
                raise ExtractError("this is no OpenStreetMap PBF file, or a damaged one")
            if at + size > len(data):
                raise ExtractError("the extract ends in the middle of a field")
            value, at = data[at : at + size], at + size
        result.setdefault(key >> 3, []).append(value)
    return result


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
        if shift > 63:
            raise ExtractError("a number in the extract is longer than 64 bits")


def _packed(data: bytes) -> Iterator[int]:
    at = 0
    while at < len(data):
        value, at = _varint(data, at)
        yield value


def _summed(deltas: Iterator[int]) -> Iterator[int]:
    """Zigzag-coded differences, added up."""
    total = 0
    for each in deltas:
        total += (each >> 1) ^ -(each & 1)
        yield total


def _int(fields: Fields, number: int) -> int:
    value = fields.get(number, [0])[-1]
    return value if isinstance(value, int) else 0


def _bytes(fields: Fields, number: int) -> bytes:
    value = fields.get(number, [b""])[-1]
    return value if isinstance(value, bytes) else b""
