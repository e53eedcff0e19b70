"""The map of a place from an archive on a real backend: where every request goes, ranges over real HTTP, bad archives."""

from __future__ import annotations

import gzip
import io
import os
import struct
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from console.test_place_screens import COVERED, FLOATING, LEAST_COLOURS, drawn
from kit import barriers
from kit.console import measure
from kit.town import a_town
from PIL import Image
from playwright.sync_api import expect

from wonderland_simulator.place import archive as writing
from wonderland_simulator.place.build import build

TOWN = "at=43.7325,7.4165,15.5"
ARCHIVE = "/api/v1/map/archive"
PATIENCE_S = 45
"""On a machine that is also drawing maps."""


@pytest.fixture(scope="module")
def town_archive(tmp_path_factory):
    """Bytes of an archive as the demo's set-up makes it, of a made-up town."""
    directory = tmp_path_factory.mktemp("town")
    (directory / "town.osm.pbf").write_bytes(a_town().pbf())
    build(directory / "town.osm.pbf", directory / "town.pmtiles")
    return (directory / "town.pmtiles").read_bytes()


@pytest.fixture
def another(tmp_path):
    """The same town with a street more: other bytes at every offset."""
    town = a_town()
    town.way([(7.4160, 43.7305), (7.4215, 43.7325), (7.4230, 43.7350)], highway="primary", name="Quai des Essais")
    (tmp_path / "another.osm.pbf").write_bytes(town.pbf())
    build(tmp_path / "another.osm.pbf", tmp_path / "another.pmtiles")
    return (tmp_path / "another.pmtiles").read_bytes()


@pytest.fixture
def placed(real_backend, town_archive, tmp_path):
    """A backend whose map is drawn from that archive."""
    path = tmp_path / "town.pmtiles"
    path.write_bytes(town_archive)
    running = real_backend(map={"archive": path})
    running.archive_file = path
    return running


@pytest.fixture
def http(placed):
    """A reader that is signed in."""
    base, _, token = placed.link().partition("/#token=")
    with httpx.Client(base_url=base, trust_env=False, timeout=PATIENCE_S) as client:
        answer = client.post("/api/v1/session", json={"token": token}, headers={"Origin": base})
        assert answer.is_success, answer.text
        yield client


def ranges_of(page):
    """The ranges of the archive that a page asks for from now on."""
    asked = []
    page.on("request", lambda request: asked.append(request) if ARCHIVE in request.url else None)
    return asked


@pytest.mark.timeout(180)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_live_session_and_replay_ask_nobody_but_their_server(placed, open_page, theme):
    page = open_page(placed.link(), theme=theme, room=f"live?{TOWN}")
    asked, everything = ranges_of(page), []
    page.on("request", lambda request: everything.append(request.url))
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    session = page.evaluate("fetch('/api/v1/verdicts').then((answer) => answer.json())")["items"][0]["session_id"]
    for address in (f"sessions/{session}", "replay?t=2026-01-01T12:00:00Z"):
        page.evaluate("(hash) => { location.hash = hash; }", f"#/{address}")
        expect(page.locator("main.room")).to_be_visible()
        page.wait_for_load_state("networkidle")
    page.goto("about:blank")
    page.goto(f"{placed.url}/#/live?{TOWN}&drone=uav-2")
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    assert any(ARCHIVE in url for url in everything), "the archive was not read"
    assert [url for url in everything if not url.startswith((placed.url, "blob:", "data:", "about:"))] == []
    assert all("range" in request.all_headers() for request in asked)


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1440, 900), (2560, 1440)])
def test_whose_map_it_is_stays_in_sight(placed, open_page, width, height):
    page = open_page(placed.link(), width=width, height=height, room=f"live?{TOWN}")
    link = page.get_by_test_id("credits").get_by_role("link", name="© OpenStreetMap contributors")
    expect(link).to_have_attribute("href", "https://www.openstreetmap.org/copyright")
    page.wait_for_load_state("networkidle")
    # In sight: what is at its middle is the link itself, with nothing over it.
    assert link.evaluate(
        """(link) => {
          const { left, top, width, height } = link.getBoundingClientRect();
          return link.contains(document.elementFromPoint(left + width / 2, top + height / 2));
        }"""
    )


def described(http):
    return http.get("/api/v1/map").json()["archive"]


def test_ranges_are_answered_and_may_be_kept(http, town_archive, placed):
    found = described(http)
    first = http.get(found["url"], headers={"Range": "bytes=0-126"})
    assert (first.status_code, first.content) == (206, town_archive[:127])
    assert first.headers["content-range"] == f"bytes 0-126/{len(town_archive)}"
    assert first.headers["etag"] == f'"{found["version"]}"'
    assert "content-encoding" not in first.headers
    end = http.get(found["url"], headers={"Range": f"bytes={len(town_archive) - 9}-{len(town_archive) + 9}"})
    assert (end.status_code, end.content) == (206, town_archive[-9:])
    whole = http.get(found["url"])
    assert (whole.status_code, whole.content) == (200, town_archive)
    head = http.head(found["url"])
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-length"] == str(len(town_archive))
    assert head.headers["accept-ranges"] == "bytes"


def test_what_is_kept_for_a_week_has_settled(http, placed):
    time.sleep(2.1)
    old = http.get(described(http)["url"], headers={"Range": "bytes=0-9"})
    bare = http.get(ARCHIVE, headers={"Range": "bytes=0-9"})
    assert "immutable" in old.headers["cache-control"]
    assert "no-cache" in bare.headers["cache-control"]
    os.utime(placed.archive_file)
    fresh = http.get(described(http)["url"], headers={"Range": "bytes=0-9"})
    assert "immutable" not in fresh.headers["cache-control"]


def test_what_a_reader_has_it_is_not_sent_again(http):
    url = described(http)["url"]
    tag = http.head(url).headers["etag"]
    same = http.get(url, headers={"If-None-Match": tag, "Range": "bytes=0-9"})
    assert (same.status_code, same.content) == (304, b"")
    assert http.get(url, headers={"If-None-Match": '"other"', "Range": "bytes=0-9"}).status_code == 206
    assert http.get(url, headers={"If-Range": tag, "Range": "bytes=0-9"}).status_code == 206
    # Another file than the reader has a part of: all of it, not a part that does not fit.
    assert http.get(url, headers={"If-Range": '"other"', "Range": "bytes=0-9"}).status_code == 200


@pytest.mark.parametrize(
    "asked",
    [
        "bytes=0-1,4-5",
        "bytes=" + ",".join(f"{each}-{each}" for each in range(1_000)),
        "bytes=99999999999-",
        "bytes=5-4",
        "bytes=-",
        "bytes=--5",
        "bytes=0x0-0xf",
        "bytes=" + "9" * 5_000 + "-",
        "bytes=0-9; drop",
    ],
)
def test_a_hostile_range_is_refused_and_the_next_is_answered(http, asked):
    url = described(http)["url"]
    answer = http.get(url, headers={"Range": asked})
    assert answer.status_code == 416
    assert len(answer.content) < 200
    assert http.get(url, headers={"Range": "bytes=0-9"}).status_code == 206


def test_a_map_is_for_those_who_are_signed_in(placed):
    with httpx.Client(base_url=placed.url, trust_env=False, timeout=PATIENCE_S) as stranger:
        for path in ("/api/v1/map", ARCHIVE, "/api/v1/map/imagery", "/api/v1/map/imagery/1/1/1"):
            assert stranger.get(path, headers={"Range": "bytes=0-9"}).status_code == 403


def test_many_read_at_once(http, town_archive):
    url = described(http)["url"]

    def part(number):
        first = number * 61 % (len(town_archive) - 500)
        return first, http.get(url, headers={"Range": f"bytes={first}-{first + 499}"})

    with ThreadPoolExecutor(16) as readers:
        for first, answer in readers.map(part, range(200)):
            assert (answer.status_code, answer.content) == (206, town_archive[first : first + 500])


def test_no_part_of_another_archive_under_the_address_of_the_first(http, placed, town_archive):
    """Overwritten in place, then replaced: an address holds for one file and no other."""
    first = described(http)["url"]
    data = bytearray(town_archive)
    data[-1] ^= 1
    placed.archive_file.write_bytes(data)
    gone = http.get(first, headers={"Range": "bytes=0-9"})
    assert (gone.status_code, gone.headers["cache-control"]) == (410, "no-store")
    second = described(http)["url"]
    assert second != first
    assert http.get(second).content == bytes(data)
    (placed.directory / "new").write_bytes(town_archive)
    (placed.directory / "new").replace(placed.archive_file)
    assert http.get(second, headers={"Range": "bytes=0-9"}).status_code == 410
    assert http.get(described(http)["url"]).content == town_archive


def test_a_console_goes_over_to_an_archive_that_replaced_its_own(placed, open_page, town_archive, another):
    page = open_page(placed.link(), room=f"live?{TOWN}")
    page.watched.expected = ("410",)
    asked = ranges_of(page)
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    old = {request.url for request in asked}
    data = another
    placed.archive_file.write_bytes(data)
    asked.clear()
    # Another part of the town is wanted: the old address no longer has it.
    page.evaluate("() => { location.hash = '#/live?at=43.70,7.36,13'; }")
    page.wait_for_function(
        "(old) => performance.getEntriesByType('resource').some(({ name }) => name.includes('map/archive') && !old.includes(name))",
        arg=list(old),
    )
    page.wait_for_load_state("networkidle")
    expect(page.locator(".map-failure")).to_have_count(0)
    # What the browser had kept of the first is the first's, everything else the second's.
    for request in asked:
        answer = request.response()
        if answer is None:
            continue  # the map had moved on, and no longer wanted it
        assert answer.status in {206, 410}
        if answer.status == 206:
            first, last = map(int, answer.headers["content-range"].removeprefix("bytes ").partition("/")[0].split("-"))
            whole = town_archive if request.url in old else data
            assert answer.body() == whole[first : last + 1]
    assert asked[-1].url not in old


def test_a_part_that_got_lost_on_the_way_is_asked_for_again(placed, open_page, browser):
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    lost = []

    def lose_the_first(route):
        asked = route.request.all_headers()["range"]
        if asked in lost:
            route.continue_()
        else:
            lost.append(asked)
            route.abort("connectionreset")

    context.route("**/api/v1/map/archive*", lose_the_first)
    page = open_page(placed.link(), context=context, room=f"live?{TOWN}")
    page.watched.expected = ("ERR_CONNECTION_RESET",)
    with page.expect_response(lambda answer: ARCHIVE in answer.url and answer.status == 206):
        expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(3_000)
    assert len(lost) > 1
    expect(page.locator(".map-failure")).to_have_count(0)
    context.close()


def header(data, **places):
    """The archive with some words of its header changed: by name, their eight bytes."""
    at = {"root": 8, "root_length": 16, "leaves": 40, "leaves_length": 48}
    for name, value in places.items():
        struct.pack_into("<Q", data, at[name], value)
    return bytes(data)


def varints(*values):
    return b"".join(writing._varint(value) for value in values)


def with_root(data, root):
    """The same archive with another root directory, at its end."""
    return header(bytearray(data), root=len(data), root_length=len(root)) + root


def circle(data):
    """A leaf directory that leads to itself."""
    leaf = gzip.compress(varints(1, 0, 0, 0, 1), mtime=0)
    for _ in range(4):
        leaf = gzip.compress(varints(1, 0, 0, len(leaf), 1), mtime=0)
    begun = with_root(data, leaf)
    return header(bytearray(begun), leaves=len(data), leaves_length=len(leaf))


HOSTILE = {
    "huge run lengths": lambda data: with_root(data, gzip.compress(varints(1, 0, 2**52, 50, 1))),
    "more entries than bytes": lambda data: with_root(data, gzip.compress(varints(2**40))),
    "entries beyond the end": lambda data: with_root(data, gzip.compress(varints(1, 0, 2**31, 2**40, 2**40))),
    "a circle of leaves": circle,
    "no gzip": lambda data: with_root(data, b"\xff" * 90),
    "a bomb": lambda data: with_root(data, gzip.compress(b"\0" * (12 << 20))),
    "tiles of noise": lambda data: data[:-2_000] + b"\xa5" * 2_000,
}


@pytest.mark.timeout(120)
@pytest.mark.parametrize("kind", HOSTILE)
def test_the_page_survives_an_archive_that_is_hostile(placed, open_page, town_archive, kind):
    placed.archive_file.write_bytes(HOSTILE[kind](town_archive))
    page = open_page(placed.link(), room=f"live?{TOWN}")
    page.watched.expected = ("404", "416", "tile", "gzip", "Error")
    expect(page.get_by_role("listbox", name="Drones").get_by_role("option")).to_have_count(2)
    page.wait_for_load_state("networkidle")
    page.get_by_role("listbox", name="Drones").get_by_role("option").first.click()
    expect(page.get_by_role("region", name="Proof")).to_be_visible()


BROKEN = {
    "cut off": (lambda path, data: path.write_bytes(data[:-500]), "it is cut off"),
    "another schema": (
        lambda path, _: writing.write(
            path, {(11, 1066, 745): b"x"}, {"vector_layers": [{"id": "water"}]}, (7, 43, 8, 44)
        ),
        "it has no layers earth, roads",
    ),
    "gone": (lambda path, _: path.unlink(), "the file cannot be read"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_missing_is_said_with_where_it_is_set(placed, open_page, town_archive, kind):
    spoil, why = BROKEN[kind]
    spoil(placed.archive_file, town_archive)
    page = open_page(placed.link(), room=f"live?{TOWN}")
    said = page.get_by_test_id("credits")
    expect(said).to_contain_text("One thing is missing from the map")
    said.get_by_role("button", name="show").click()
    expect(said).to_contain_text(why)
    assert page.evaluate(COVERED, FLOATING) == []
    expect(said.locator("code")).to_have_text("WONDERLAND_BACKEND_MAP__ARCHIVE")
    expect(page.get_by_role("listbox", name="Drones").get_by_role("option")).to_have_count(2)
    assert barriers.anywhere(page) == []


@pytest.mark.timeout(120)
def test_a_damaged_part_is_said_with_where_the_archive_is_set(placed, open_page, town_archive):
    tiles = struct.unpack_from("<Q", town_archive, 56)[0]
    placed.archive_file.write_bytes(town_archive[:tiles] + b"\xa5" * (len(town_archive) - tiles))
    page = open_page(placed.link(), room=f"live?{TOWN}")
    page.watched.expected = ("tile", "gzip", "Error")
    said = page.get_by_test_id("credits")
    said.get_by_role("button", name="show").click()
    expect(said).to_contain_text("A part of the map of the place is damaged. Set by WONDERLAND_BACKEND_MAP__ARCHIVE.")


@pytest.mark.timeout(180)
def test_where_images_do_not_come_the_drawn_ground_stays_and_the_camera(
    real_backend, town_archive, tmp_path, open_page
):
    path = tmp_path / "town.pmtiles"
    path.write_bytes(town_archive)
    running = real_backend(map={"archive": path, "wmts": "http://127.0.0.1:9/{z}/{x}/{y}"})
    measure(running, lat_e7=437_325_000, lon_e7=74_165_000)
    page = open_page(running.link(), room=f"live?{TOWN}")
    before = drawn(page)
    page.keyboard.press("b")
    said = page.get_by_test_id("credits")
    expect(said).to_contain_text("One thing is missing from the map", timeout=60_000)
    assert drawn(page) >= before >= LEAST_COLOURS
    page.get_by_role("button", name="Vaihda suomeen").click()
    said.get_by_role("button", name="näytä").click()
    expect(said).to_contain_text("Ilmakuvat puuttuvat: WMTS ei ole tavoitettavissa")


def test_an_archive_of_elsewhere_is_said_and_coasts_are_shown(real_backend, town_archive, tmp_path, open_page):
    path = tmp_path / "town.pmtiles"
    path.write_bytes(town_archive)
    page = open_page(real_backend(map={"archive": path}).link(), room="live")
    said = page.get_by_test_id("credits")
    said.get_by_role("button", name="show").click()
    expect(said).to_contain_text("does not cover the pads")
    expect(said.locator("code")).to_have_text("WONDERLAND_BACKEND_MAP__ARCHIVE")
    expect(page.get_by_role("button", name="Closer")).to_be_visible()
    for depth in ("Aslant, with heights", "Flat, from above"):
        expect(page.get_by_role("button", name=depth)).to_have_count(0)
    page.wait_for_function("() => /at=60[.]/.test(location.hash)")
    assert ",52.0" not in page.url, "looked at aslant where there is no building"


def test_fifty_gigabytes_are_shown_as_quickly_as_some_kilobytes(placed, http, open_page):
    with placed.archive_file.open("r+b") as file:
        file.truncate(50 << 30)  # sparse: it needs no disk
    answer = http.get(ARCHIVE)
    assert answer.status_code == 416
    assert http.head(ARCHIVE).headers["content-length"] == str(50 << 30)
    page = open_page(placed.link(), room=f"live?{TOWN}")
    asked = ranges_of(page)
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    sizes = [request.sizes()["responseBodySize"] for request in asked]
    assert sum(sizes) < 1 << 20


def hills(path):
    """Heights around the town: a ridge for each 64 pixels, 256 m high, as Terrarium images."""
    picture = Image.new("RGB", (512, 512))
    for x in range(512):
        height_m = 32768 + 200 + abs(x % 64 - 32) * 8
        picture.paste((int(height_m) >> 8, int(height_m) & 255, int(height_m * 256) & 255), (x, 0, x + 1, 512))
    tile = io.BytesIO()
    picture.save(tile, "PNG")
    tiles = {(12, x, y): tile.getvalue() for x in range(2131, 2135) for y in range(1491, 1496)}
    writing.write(path, tiles, {"attribution": "© Surveyors"}, (7.30, 43.65, 7.55, 43.80))
    data = bytearray(path.read_bytes())
    data[98:100] = bytes([1, 2])  # tiles as they are, PNG
    path.write_bytes(data)
    return path


@pytest.mark.timeout(180)
def test_slopes_are_shaded_where_there_are_heights(real_backend, town_archive, open_page, tmp_path):
    (tmp_path / "town.pmtiles").write_bytes(town_archive)
    heights = hills(tmp_path / "hills.pmtiles")

    def shades(patience_s=0, **more):
        """Colours of a piece of the town without streets, drones or panels."""
        running = real_backend(map={"archive": tmp_path / "town.pmtiles", **more})
        page = open_page(running.link(), room="live?at=43.7322,7.4172,17.0,0.0,0.0")
        expect(page.get_by_test_id("credits")).to_contain_text("© Surveyors" if more else "OpenStreetMap")
        deadline = time.monotonic() + patience_s
        while True:
            page.wait_for_load_state("networkidle")
            page.wait_for_timeout(500)
            shot = page.screenshot(clip={"x": 460, "y": 60, "width": 300, "height": 100})
            found = len(Image.open(io.BytesIO(shot)).convert("RGB").getcolors(1 << 24))
            if found > 8 or time.monotonic() > deadline:
                return found

    assert shades() < 5
    assert shades(60, terrain=heights) > 8, "the ground is as flat as without heights"


@pytest.mark.timeout(240)
def test_the_map_of_a_place_is_free_of_barriers_and_goes_by_keys(placed, open_page):
    measure(placed, lat_e7=437_325_000, lon_e7=74_165_000)  # a pad in the town: elsewhere it would be looked at flat
    page = open_page(placed.link(), room=f"live?{TOWN}")
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    found = barriers.anywhere(page)
    assert found == [], "\n".join(found)
    page.wait_for_function("() => /,-?[0-9.]+,52.0/.test(location.hash)")
    before = page.evaluate("() => location.hash.match(/,(-?[0-9.]+),52.0/)[1]")
    page.keyboard.press("]")
    page.wait_for_function(
        "(before) => /,-?[0-9.]+,52.0/.test(location.hash) && !location.hash.includes(`,${before},52`)", arg=before
    )
    found = barriers.anywhere(page)
    assert found == [], "\n".join(found)
