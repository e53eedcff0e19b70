"""Base maps: an archive by ranges, what is wrong with one, a WMTS that hangs."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import os
import struct
import time
import tracemalloc

import pytest

from wonderland import messages
from wonderland_backend.http.transfer import new_client
from wonderland_backend.maps.archive import Archive, ArchiveError, ReplacedError, credits_of
from wonderland_backend.maps.imagery import Imagery, ImageryError
from wonderland_backend.maps.ranges import MAX_PART, RangeError, parse
from wonderland_backend.maps.service import Maps
from wonderland_backend.settings.maps import MapSettings
from wonderland_simulator.place.archive import write

CODES = messages.keys_of("maps")
"""For which the console has words."""
LAYERS = ("earth", "water", "roads")


def made(path, layers=LAYERS, attribution="© Somebody", tile=b"tile"):
    metadata = {"attribution": attribution, "vector_layers": [{"id": each} for each in layers]}
    write(path, {(11, 1066, 745): tile, (11, 1067, 745): b"other"}, metadata, (7.3, 43.6, 7.5, 43.8))
    return path


def test_an_archive_is_described(tmp_path):
    found = Archive(made(tmp_path / "a.pmtiles"), vector=True).describe()
    assert (found.kind, found.bounds, found.min_zoom, found.layers) == ("vector", (7.3, 43.6, 7.5, 43.8), 11, LAYERS)


def damage(path, change):
    data = bytearray(path.read_bytes())
    change(data)
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda path: damage(path, lambda data: data.__delitem__(slice(-3, None))), "cut off"),
        (lambda path: path.write_bytes(b""), "no PMTiles archive"),
        (lambda path: path.write_text("<html>" * 99), "no PMTiles archive"),
        (lambda path: damage(path, lambda data: data.__setitem__(7, 2)), "no PMTiles archive of version 3"),
        (lambda path: damage(path, lambda data: data.__setitem__(99, 2)), "its tiles are png, not vector tiles"),
        (lambda path: damage(path, lambda data: data.__setitem__(97, 4)), "packed in a way"),
        (lambda path: made(path, ("transportation", "water")), "no layers earth, roads"),
        (lambda path: path.unlink(), "cannot be read"),
    ],
)
def test_what_is_wrong_with_an_archive_is_said_and_where_it_is_set(tmp_path, spoil, why):
    path = made(tmp_path / "a.pmtiles")
    spoil(path)
    maps = Maps(MapSettings(archive=path), new_client())
    (missing,) = maps.describe("/api/v1")["missing"]
    assert why in missing["why"]
    assert missing["code"] in CODES
    assert str(tmp_path) not in str(missing)
    assert str(tmp_path) not in missing["why"]
    assert missing["setting"] == "WONDERLAND_BACKEND_MAP__ARCHIVE"


def test_terrain_says_how_its_pixels_are_read_and_what_is_wrong_with_it(tmp_path):
    path = made(tmp_path / "heights.pmtiles")
    settings = MapSettings(terrain=path, terrain_encoding="mapbox")
    told = Maps(settings, new_client()).describe("/api/v1")
    (missing,) = told["missing"]
    assert (missing["what"], missing["setting"]) == ("terrain", "WONDERLAND_BACKEND_MAP__TERRAIN")
    assert (missing["code"], missing["facts"]) == ("kind", {"kind": "vector", "wanted": "images"})
    damage(path, lambda data: data.__setitem__(slice(98, 100), bytes([1, 2])))
    told = Maps(settings, new_client()).describe("/api/v1")
    assert told["missing"] == []
    assert (told["terrain"]["kind"], told["terrain"]["encoding"]) == ("png", "mapbox")
    assert told["terrain"]["url"].startswith("/api/v1/map/terrain?v=")


def test_fifty_gigabytes_are_read_by_their_parts(tmp_path):
    path = made(tmp_path / "a.pmtiles")
    with path.open("r+b") as file:
        file.truncate(50 << 30)  # sparse: it needs no disk
        file.seek((50 << 30) - 4)
        file.write(b"last")
    archive = Archive(path, vector=True)
    assert archive.describe().size_bytes == 50 << 30
    assert archive.part((50 << 30) - 4, 4, archive.describe().tag) == b"last"


def test_a_replaced_archive_has_another_tag(tmp_path):
    path = made(tmp_path / "a.pmtiles")
    archive = Archive(path, vector=True)
    before = archive.describe().tag
    made(tmp_path / "b.pmtiles", tile=b"another")
    (tmp_path / "b.pmtiles").replace(path)
    after = archive.describe().tag
    assert after != before
    assert archive.part(0, 7, after) == b"PMTiles"
    with pytest.raises(ReplacedError):
        archive.part(0, 7, before)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ArchiveError):
        archive.part(0, 7, after)
    made(path)
    assert archive.describe().kind == "vector"


def test_an_archive_overwritten_in_place_with_its_time_set_back_is_another_one(tmp_path):
    """As a copying program does that keeps times: same inode, same size, same time of modification."""
    path = made(tmp_path / "a.pmtiles", tile=b"one!")
    archive = Archive(path, vector=True)
    before, status = archive.describe(), path.stat()
    time.sleep(0.02)  # times of change are as coarse as the kernel's clock
    damage(path, lambda data: data.__setitem__(slice(-9, -5), b"two!"))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert (path.stat().st_ino, path.stat().st_size) == (status.st_ino, status.st_size)
    assert archive.describe().tag != before.tag
    with pytest.raises(ReplacedError):
        archive.part(0, 7, before.tag)


def test_an_archive_overwritten_while_a_part_is_read_gives_none(tmp_path, monkeypatch):
    path = made(tmp_path / "a.pmtiles")
    archive = Archive(path, vector=True)
    tag = archive.describe().tag
    read = os.pread

    def overwritten(file, length, first):
        body = read(file, length, first)
        time.sleep(0.02)
        damage(path, lambda data: data.__setitem__(-1, 0))
        return body

    monkeypatch.setattr(os, "pread", overwritten)
    with pytest.raises(ReplacedError):
        archive.part(0, 7, tag)


@pytest.mark.parametrize(
    ("put", "why"),
    [
        (os.mkfifo, "it is no file"),
        (os.mkdir, "it is no file"),
        (lambda path: path.symlink_to("/dev/zero"), "it is no file"),
        (lambda path: path.symlink_to(path), "cannot be read"),
    ],
)
@pytest.mark.timeout(10)
def test_what_is_no_file_holds_nobody_up(tmp_path, put, why):
    path = tmp_path / "a.pmtiles"
    put(path)
    with pytest.raises(ArchiveError, match=why):
        Archive(path, vector=True).describe()


def test_a_symlink_to_an_archive_is_one_and_may_be_turned(tmp_path):
    made(tmp_path / "one.pmtiles")
    made(tmp_path / "two.pmtiles", attribution="© Another")
    path = tmp_path / "a.pmtiles"
    path.symlink_to("one.pmtiles")
    archive = Archive(path, vector=True)
    assert archive.describe().attribution[0].text == "© Somebody"
    path.unlink()
    path.symlink_to("two.pmtiles")
    assert archive.describe().attribution[0].text == "© Another"


def test_metadata_that_unpacks_to_a_gigabyte_is_refused_in_little_memory(tmp_path):
    path = made(tmp_path / "a.pmtiles")
    words = gzip.compress(b" " * (64 << 20))
    data = bytearray(path.read_bytes())
    struct.pack_into("<2Q", data, 24, len(data), len(words))
    path.write_bytes(bytes(data) + words)
    tracemalloc.start()
    try:
        with pytest.raises(ArchiveError, match="metadata"):
            Archive(path, vector=True).describe()
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("header", "expected"),
    [("bytes=0-15", (0, 16)), ("bytes=90-", (90, 10)), ("bytes=90-500", (90, 10)), (None, (0, 100))],
)
def test_one_range_is_understood(header, expected):
    assert parse(header, 100) == expected


@pytest.mark.parametrize(
    "header", ["bytes=100-", "bytes=5-4", "bytes=0-1,4-5", "bytes=-5", "lines=0-1", "bytes=" + "9" * 40 + "-"]
)
def test_another_range_is_refused(header):
    with pytest.raises(RangeError):
        parse(header, 100)


def test_no_answer_is_larger_than_a_tile_may_be():
    with pytest.raises(RangeError):
        parse(f"bytes=0-{MAX_PART}", 50 << 30)
    with pytest.raises(RangeError):
        parse(None, 50 << 30)


def test_an_attribution_is_text_and_safe_links():
    found = credits_of(
        '<a href="https://a.example/x">A &amp; B</a> <script>x</script><a href="javascript:alert(1)">C</a>'
    )
    assert [(each.text, each.href) for each in found] == [("A & B", "https://a.example/x"), ("x", ""), ("C", "")]


@contextlib.asynccontextmanager
async def wmts(answer):
    tasks = []

    async def served(reader, writer):
        tasks.append(asyncio.current_task())
        with contextlib.suppress(ConnectionError, asyncio.CancelledError):
            await reader.readuntil(b"\r\n\r\n")
            await answer(writer)
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()

    server = await asyncio.start_server(served, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        yield f"http://127.0.0.1:{port}/{{z}}/{{x}}/{{y}}.png"
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def test_a_wmts_that_hangs_costs_little_and_is_left_alone():
    asked = 0

    async def hang(writer):
        nonlocal asked
        asked += 1
        await asyncio.sleep(5)

    async with wmts(hang) as url, new_client() as client:
        imagery = Imagery(MapSettings(wmts=url, wmts_timeout_s=0.2), client)
        for _ in range(3):
            with pytest.raises(ImageryError, match="does not answer within"):
                await imagery.tile(3, 4, 2)
        assert asked == 1
        assert imagery.failure is not None
        assert (imagery.failure.code, "limit" in imagery.failure.facts) == ("wmts_slow", True)


async def test_images_are_kept_and_nothing_but_images_is_passed_on():
    asked = 0

    async def one(writer):
        nonlocal asked
        asked += 1
        kind = b"image/png" if asked == 1 else b"text/html"
        writer.write(
            b"HTTP/1.1 200 OK\r\nContent-Type: " + kind + b"\r\nContent-Length: 3\r\nConnection: close\r\n\r\npng"
        )
        await writer.drain()

    async with wmts(one) as url, new_client() as client:
        imagery = Imagery(MapSettings(wmts=url), client)
        assert await imagery.tile(3, 4, 2) == ("image/png", b"png")
        assert await imagery.tile(3, 4, 2) == ("image/png", b"png")
        assert asked == 1
        with pytest.raises(ImageryError, match="text/html"):
            await imagery.tile(3, 4, 3)


def answer_of(status, headers, body=b""):
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    return f"HTTP/1.1 {status}\r\n{head}Connection: close\r\n\r\n".encode() + body


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (answer_of("500 Oh", {"Content-Length": 0}), "answers with 500"),
        (answer_of("200 OK", {"Content-Type": "text/html", "Content-Length": 4}, b"<p/>"), "text/html"),
        (answer_of("200 OK", {"Content-Type": "image/svg+xml", "Content-Length": 6}, b"<svg/>"), "svg"),
        (
            answer_of(
                "200 OK", {"Content-Type": "image/png", "Content-Encoding": "gzip"}, gzip.compress(b"\0" * (32 << 20))
            ),
            "packs",
        ),
        (b"nonsense\r\n\r\n", "cannot be reached"),
    ],
)
async def test_what_a_wmts_should_not_answer_is_passed_on_to_nobody(answer, why):
    async def given(writer):
        writer.write(answer)
        await writer.drain()

    async with wmts(given) as url, new_client() as client:
        with pytest.raises(ImageryError, match=why):
            await Imagery(MapSettings(wmts=url), client).tile(3, 4, 2)


async def test_a_wmts_leads_this_server_nowhere_else():
    asked = []

    async def inner(writer):
        asked.append("inner")
        writer.write(answer_of("200 OK", {"Content-Type": "image/png", "Content-Length": 3}, b"png"))
        await writer.drain()

    async with wmts(inner) as elsewhere:

        async def leads(writer):
            writer.write(answer_of("302 Found", {"Location": elsewhere, "Content-Length": 0}))
            await writer.drain()

        async with wmts(leads) as url, new_client() as client:
            with pytest.raises(ImageryError, match="elsewhere"):
                await Imagery(MapSettings(wmts=url), client).tile(3, 4, 2)
    assert asked == []


async def test_two_hundred_megabytes_of_a_wmts_are_cut_off():
    sent = 0

    async def much(writer):
        nonlocal sent
        writer.write(answer_of("200 OK", {"Content-Type": "image/png", "Content-Length": 200 << 20}))
        for _ in range(200):
            writer.write(b"\0" * (1 << 20))
            await writer.drain()
            sent += 1

    async with wmts(much) as url, new_client() as client:
        imagery = Imagery(MapSettings(wmts=url), client)
        with pytest.raises(ImageryError, match="more than 2 MB"):
            await imagery.tile(3, 4, 2)
    assert sent < 20


@pytest.mark.parametrize(
    "url", ["ftp://a/{z}/{x}/{y}", "https://a/{z}/{x}", "https://user:x@a/{z}/{x}/{y}", "{z}{x}{y}"]
)
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(ValueError, match="wmts"):
        MapSettings(wmts=url)


def test_aerial_images_come_from_one_place(tmp_path):
    with pytest.raises(ValueError, match="one of them"):
        MapSettings(imagery=tmp_path, wmts="https://a/{z}/{x}/{y}")
