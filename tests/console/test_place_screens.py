"""Live map, session, pad and replay over a place, on every kind of screen: it is drawn, and nothing covers anything.

``WONDERLAND_SCREENS=DIR`` keeps the pictures.
"""

from __future__ import annotations

import io
import os
import re
import zlib
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from kit.console import measure
from kit.town import a_town
from PIL import Image
from playwright.sync_api import expect

from wonderland_simulator.place.build import build

PLACE = {"lat_e7": 437_325_000, "lon_e7": 74_165_000}
AT = "at=43.73175,7.41701"
ZOOMS = (14.5, 16.5, 19.0)
SCREENS = {
    "light": {"width": 1440, "height": 900},
    "dark": {"width": 1440, "height": 900, "theme": "dark"},
    "phone": {"width": 390, "height": 844},
    "large": {"width": 2560, "height": 1440},
}
ENOUGH = 0.004
"""Share of the map that a colour of its ground has, and no edge, drone or line."""
LEAST_COLOURS = 2
"""Paper has one."""
MAP_ALONE = ".float, .map-tools, .map-credits, .map-labels, .replay-badge, .wall-side { visibility: hidden }"
FLOATING = ".float, .panel-foot, .header, .rail, .map-tools > *, [data-testid=credits], .replay-badge"
COVERED = """(selector) => {
  const seen = [...document.querySelectorAll(selector)].filter((element) => element.checkVisibility());
  const boxes = seen.map((element) => [element, element.getBoundingClientRect()]).filter(([, box]) => box.width * box.height > 0);
  const found = [];
  for (const [one, a] of boxes) for (const [other, b] of boxes) {
    if (one === other || one.contains(other) || other.contains(one)) continue;
    const [width, height] = [Math.min(a.right, b.right) - Math.max(a.left, b.left), Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)];
    if (width > 1 && height > 1) found.push(`${one.className} / ${other.className}: ${Math.round(width)} × ${Math.round(height)}`);
  }
  return [...new Set(found)];
}"""


@pytest.fixture(scope="module")
def town_file(tmp_path_factory):
    """An archive of a made-up town around the pad."""
    directory = tmp_path_factory.mktemp("town")
    (directory / "town.osm.pbf").write_bytes(a_town().pbf())
    build(directory / "town.osm.pbf", directory / "town.pmtiles")
    return directory / "town.pmtiles"


def keep(page, name, full_page=False):
    """For whoever wants to look at it."""
    if directory := os.environ.get("WONDERLAND_SCREENS"):
        Path(directory).mkdir(parents=True, exist_ok=True)
        page.wait_for_timeout(1_500)  # software draws the marks on a map last
        page.screenshot(path=Path(directory) / f"{name}.png", full_page=full_page)


def tidy(page):
    """Nothing covers anything, nothing runs out at the side."""
    assert page.evaluate(COVERED, FLOATING) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "it scrolls sideways"


def drawn(page):
    """The map shows the place: more colours than paper, a pad and two drones have."""
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(500)
    shot = page.locator("canvas.maplibregl-canvas").first.screenshot(style=MAP_ALONE)
    picture = Image.open(io.BytesIO(shot)).convert("RGB")
    return sum(1 for count, _ in picture.getcolors(1 << 24) if count > ENOUGH * picture.width * picture.height)


@pytest.mark.timeout(400)
@pytest.mark.parametrize("screen", SCREENS)
def test_the_place_on_every_screen(real_backend, town_file, open_page, screen):
    running = real_backend(map={"archive": town_file})
    session = measure(running, **PLACE)
    link = running.link()
    page = open_page(link, room=f"live?{AT},{ZOOMS[0]}", **SCREENS[screen])

    def go(address):
        page.evaluate("(hash) => { location.hash = hash; }", f"#/{address}")

    for zoom in ZOOMS:
        go(f"live?{AT},{zoom}")
        page.wait_for_function("(zoom) => location.hash.includes(zoom)", arg=f",{zoom:.2f}")
        colours = drawn(page)
        keep(page, f"{screen}-live-{zoom}")
        tidy(page)
        assert colours >= LEAST_COLOURS, f"{colours} colours at zoom {zoom}: nothing but paper"
    moment = datetime.now(UTC) - timedelta(seconds=5)
    go(f"replay?t={moment:%Y-%m-%dT%H:%M:%SZ}&{AT},16.5&session={session}")
    expect(page.get_by_text("Replay, not live")).to_be_visible()
    colours = drawn(page)
    keep(page, f"{screen}-replay")
    tidy(page)
    assert colours >= LEAST_COLOURS
    go(f"sessions/{session}")
    expect(page.get_by_role("heading", name="How it was decided")).to_be_visible()
    expect(page.get_by_test_id("credits")).to_contain_text("OpenStreetMap")
    page.wait_for_load_state("networkidle")
    keep(page, f"{screen}-session", full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    go("registry/pads/pad-1")
    expect(page.get_by_role("heading", name="Site plan")).to_be_visible()
    page.wait_for_load_state("networkidle")
    keep(page, f"{screen}-pad", full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def images_in(pdf):
    """(width, height, RGB bytes) of the images of a PDF as Chromium writes it."""
    for found in re.finditer(rb"<<[^>]*?/Subtype\s*/Image.*?>>\s*stream\r?\n", pdf, re.DOTALL):
        sizes = (re.search(rb"/%s (\d+)" % name, found[0]) for name in (b"Width", b"Height", b"Length"))
        width, height, length = (int(size[1]) for size in sizes)
        raw = zlib.decompress(pdf[found.end() : found.end() + length])
        if len(raw) == 3 * width * height:
            yield width, height, raw


@pytest.mark.timeout(240)
def test_the_place_on_a_wall_and_on_paper(real_backend, town_file, open_page):
    running = real_backend(map={"archive": town_file})
    session = measure(running, **PLACE)
    page = open_page(running.link(), width=1920, height=1080, theme="dark", room="live?wall")
    drawn(page)  # so near to its one pad that there is land alone
    keep(page, "wall")
    tidy(page)
    page.evaluate("(hash) => { location.hash = hash; }", f"#/sessions/{session}")
    expect(page.get_by_role("heading", name="How it was decided")).to_be_visible()
    page.wait_for_load_state("networkidle")
    page.emulate_media(media="print")
    keep(page, "print-session", full_page=True)
    page.emulate_media()
    pdf = page.pdf(print_background=True)
    maps = [raw for width, height, raw in images_in(pdf) if width > 400 and height > 200]
    light = [raw for raw in maps if sum(raw[::7]) / len(raw[::7]) > 225]
    assert light, "no map on the paper, or a dark one"
    assert page.locator(".map-print").count() == 0
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
