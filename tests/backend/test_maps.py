"""Base maps: an archive by ranges, what is wrong with one, a WMTS that hangs."""

from __future__ import annotations

import asyncio
import contextlib

import pytest

from backend.http.transfer import new_client
from backend.maps.archive import Archive, ArchiveError, credits_of
from backend.maps.imagery import Imagery, ImageryError
from backend.maps.ranges import MAX_PART, RangeError, parse
from backend.maps.service import Maps
from backend.maps.settings import MapSettings
from simulator.place.archive import write

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
    assert str(tmp_path) not in missing["why"]
    assert missing["setting"] == "WONDERLAND_BACKEND_MAP__ARCHIVE"


def test_fifty_gigabytes_are_read_by_their_parts(tmp_path):
    path = made(tmp_path / "a.pmtiles")
    with path.open("r+b") as file:
        file.truncate(50 << 30)  # sparse: it needs no disk
        file.seek((50 << 30) - 4)
        file.write(b"last")
    archive = Archive(path, vector=True)
    assert archive.describe().size_bytes == 50 << 30
    assert archive.part((50 << 30) - 4, 4)[0] == b"last"


def test_a_replaced_archive_has_another_tag(tmp_path):
    path = made(tmp_path / "a.pmtiles")
    archive = Archive(path, vector=True)
    before = archive.describe().tag
    made(tmp_path / "b.pmtiles", tile=b"another")
    (tmp_path / "b.pmtiles").replace(path)
    body, after = archive.part(0, 7)
    assert body == b"PMTiles"
    assert after.tag != before
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ArchiveError):
        archive.part(0, 7)
    made(path)
    assert archive.describe().kind == "vector"


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
        assert "does not answer" in imagery.failure


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


@pytest.mark.parametrize(
    "url", ["ftp://a/{z}/{x}/{y}", "https://a/{z}/{x}", "https://user:x@a/{z}/{x}/{y}", "{z}{x}{y}"]
)
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(ValueError, match="wmts"):
        MapSettings(wmts=url)


def test_aerial_images_come_from_one_place(tmp_path):
    with pytest.raises(ValueError, match="one of them"):
        MapSettings(imagery=tmp_path, wmts="https://a/{z}/{x}/{y}")
