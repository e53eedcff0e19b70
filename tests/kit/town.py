"""An OpenStreetMap extract of a made-up quay, written as PBF by the test itself."""

from __future__ import annotations

import struct
import zlib


def varint(value):
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(out) + bytes([value])


def part(number, data):
    return varint(number << 3 | 2) + varint(len(data)) + data


def number(field, value):
    return varint(field << 3) + varint(value)


def zigzag(value):
    return value << 1 if value >= 0 else (-value << 1) - 1


def deltas(values):
    last, out = 0, b""
    for value in values:
        out += varint(zigzag(value - last))
        last = value
    return out


def packed(values):
    return b"".join(map(varint, values))


def blob(kind, data):
    body = part(3, zlib.compress(data)) + number(2, len(data))
    header = part(1, kind.encode()) + number(3, len(body))
    return struct.pack(">I", len(header)) + header + body


class Town:
    """Nodes by place, ways by their nodes; as few features as a test needs."""

    def __init__(self):
        self.strings = [""]
        self.nodes, self.ways = [], []

    def word(self, text):
        if text not in self.strings:
            self.strings.append(text)
        return self.strings.index(text)

    def node(self, lon, lat, **tags):
        self.nodes.append((lon, lat, tags))
        return len(self.nodes)

    def way(self, points, closed=False, **tags):
        nodes = [self.node(*point) for point in points]
        self.ways.append((nodes + nodes[:1] if closed else nodes, tags))

    def pbf(self):
        tagged = []
        for _, _, tags in self.nodes:
            for key, value in tags.items():
                tagged += [self.word(key), self.word(value)]
            tagged.append(0)
        dense = part(1, deltas(range(1, len(self.nodes) + 1)))
        dense += part(8, deltas(round(lat * 1e7) for _, lat, _ in self.nodes))
        dense += part(9, deltas(round(lon * 1e7) for lon, _, _ in self.nodes)) + part(10, packed(tagged))
        group = part(2, dense)
        for index, (nodes, tags) in enumerate(self.ways, 1):
            keys, values = packed(map(self.word, tags)), packed(map(self.word, tags.values()))
            group += part(3, number(1, index) + part(2, keys) + part(3, values) + part(8, deltas(nodes)))
        table = b"".join(part(1, text.encode()) for text in self.strings)
        return blob("OSMHeader", part(4, b"OsmSchema-V0.6")) + blob("OSMData", part(1, table) + part(2, group))


def a_town():
    """A coast from south-west to north-east with land on its left, a street, three buildings."""
    made = Town()
    made.way([(7.4105, 43.7212), (7.4200, 43.7280), (7.4425, 43.7503)], natural="coastline")
    made.way([(7.4150, 43.7300), (7.4200, 43.7340)], highway="residential", name="Rue des Essais")
    for index, tags in enumerate(({"height": "21"}, {"building:levels": "5"}, {})):
        west, south = 7.4160 + index * 0.0008, 43.7310 + index * 0.0006
        ring = [(west, south), (west + 0.0004, south), (west + 0.0004, south + 0.0003), (west, south + 0.0003)]
        made.way(ring, closed=True, building="yes", **tags)
    made.node(7.4180, 43.7320, natural="tree")
    return made
