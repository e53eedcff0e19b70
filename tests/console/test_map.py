"""The live map in Chromium: everything that one can do with it, on the scripted world and on a real backend."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

ROOT = Path(__file__).resolve().parents[2]
TOWN = "at=60.445,22.255,13"
# How many drones the last draw call drew: all of them are points of one call.
COUNT_POINTS = """
(() => {
  const gl = WebGL2RenderingContext.prototype;
  const { drawArrays } = gl;
  gl.drawArrays = function (mode, first, count) {
    if (mode === gl.POINTS) window.drawn = count;
    drawArrays.call(this, mode, first, count);
  };
})();
"""


@pytest.fixture
def counted(browser):
    """A context whose pages count the drones that are drawn."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    context.add_init_script(COUNT_POINTS)
    yield context
    context.close()


def drones(page):
    return page.get_by_role("listbox", name="Drones").get_by_role("option")


def free_middle(page):
    """The middle of the map that no panel covers."""
    return page.evaluate(
        """() => {
          const box = (name) => document.querySelector(name).getBoundingClientRect();
          const [live, list, strip] = [box('.live'), box('.list'), box('.strip-panel')];
          return [(list.right + live.right) / 2, (live.top + strip.top) / 2];
        }"""
    )


@pytest.mark.parametrize(("flags", "least"), [("58,frozen", 12), ("58,frozen,many", 1_012)])
def test_all_drones_are_drawn_in_one_call(scripted, open_page, counted, flags, least):
    page = open_page(f"{scripted}?fake={flags}#/live?{TOWN}", context=counted)
    page.wait_for_function(f"() => window.drawn === {least}")


def test_a_filter_holds_for_list_map_and_table_and_stands_in_the_address(scripted, open_page, counted):
    page = open_page(f"{scripted}?fake=58,frozen#/live?{TOWN}", context=counted)
    expect(drones(page)).to_have_count(12)
    page.get_by_role("button", name="Filter").click()
    page.get_by_role("combobox", name="State").select_option("refuted")
    expect(drones(page)).to_have_count(1)
    expect(page.get_by_text("1 of 12 shown")).to_be_visible()
    page.wait_for_function("() => window.drawn === 1")
    page.get_by_role("combobox", name="Pad", exact=True).select_option("aurajoki-2")
    expect(drones(page)).to_have_count(1)
    assert "look=refuted" in page.url
    assert "pad=aurajoki-2" in page.url
    page.keyboard.press("Escape")
    page.get_by_role("button", name="As a table").click()
    expect(page.get_by_role("table").get_by_role("row")).to_have_count(2)
    page.reload()
    expect(page.get_by_role("table").get_by_role("row")).to_have_count(2)
    page.go_back()
    expect(page.get_by_role("table")).to_have_count(0)
    expect(drones(page)).to_have_count(1)
    page.get_by_role("button", name="Show all").click()
    expect(drones(page)).to_have_count(12)
    assert "look" not in page.url


def test_the_table_says_what_the_map_shows(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/live?table")
    table = page.get_by_role("table")
    expect(table.get_by_role("row")).to_have_count(13)
    row = table.get_by_role("row").filter(has_text="OH-DRN-0417")
    expect(row).to_contain_text("Refuted")
    expect(row).to_contain_text("Aurajoki 2")
    expect(row).to_contain_text("60.45")
    row.get_by_role("link").click()
    expect(page.get_by_role("region", name="Proof")).to_contain_text("OH-DRN-0417")
    expect(page.get_by_test_id("map")).to_be_visible()


def test_distances_are_measured_by_pointer_and_by_keys(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/live?{TOWN}")
    expect(drones(page)).to_have_count(12)
    page.wait_for_timeout(1_500)
    page.keyboard.press("m")
    measure = page.get_by_role("region", name="Measure")
    expect(measure).to_contain_text("Press a place to begin.")
    x, y = free_middle(page)
    page.mouse.click(x - 100, y)
    page.mouse.click(x + 100, y)
    # 200 pixels of zoom 13 at 60.445°: 200 · 40,075 km · cos(60.445°) / (512 · 2¹³).
    expect(measure).to_contain_text(re.compile(r"94\d\sm, 90° from true north"))
    expect(page).to_have_url(re.compile(r"measure=60\.4\d+,22\.2\d+;60\.4\d+,22\.2\d+"))
    page.reload()
    expect(measure).to_contain_text(re.compile(r"94\d\sm"))
    page.wait_for_timeout(1_000)
    page.keyboard.press("Enter")
    expect(measure).to_contain_text("over 2 legs")
    page.keyboard.press("Backspace")
    page.keyboard.press("Backspace")
    expect(measure).to_contain_text("Press a place to begin.")
    page.keyboard.press("Escape")
    expect(measure).to_have_count(0)
    assert "measure" not in page.url


def test_the_camera_follows_a_drone_until_somebody_drags_the_map(scripted, open_page):
    page = open_page(f"{scripted}?fake=58#/live?drone=SE-UAS-7715&{TOWN}")
    button = page.get_by_role("button", name="Follow on the map")
    expect(button).to_have_attribute("aria-pressed", "false")
    page.wait_for_timeout(1_000)
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    expect(page).to_have_url(re.compile("follow"))
    # It flies circles: the camera goes with it.
    page.wait_for_function("() => Number(location.hash.split(',').at(-1)) >= 15")
    places = set()
    for _ in range(40):
        places.add(page.url.split("at=")[1])
        if len(places) > 2:
            break
        page.wait_for_timeout(500)
    assert len(places) > 2
    x, y = page.evaluate(
        """() => {
          const box = (name) => document.querySelector(name).getBoundingClientRect();
          return [(box('.list').right + box('.panel').left) / 2, 300];
        }"""
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 40, steps=6)
    page.mouse.up()
    expect(button).to_have_attribute("aria-pressed", "false")
    assert "follow" not in page.url


def test_the_wall_needs_nobody(scripted, open_page):
    page = open_page(f"{scripted}?fake=58#/live?wall", width=2560, height=1440)
    wall = page.get_by_role("region", name="Wall display")
    expect(wall.get_by_role("heading", level=2)).to_have_text("Refuted")
    expect(wall).to_contain_text(re.compile(r"OH-DRN-0\d+"))
    # As the list has them, not all that needs the officer.
    refuted = page.evaluate("Number(document.querySelector('.wall-counts .look-refuted').textContent)")
    assert 0 < refuted < 6
    expect(wall.locator(".wall-counts li")).to_have_count(4)
    expect(page.get_by_role("banner")).to_be_hidden()
    expect(page.get_by_role("navigation")).to_be_hidden()
    first = wall.get_by_role("article").inner_text()
    # Each refusal has its turn.
    expect(wall.get_by_role("article")).not_to_have_text(first, timeout=30_000)
    page.keyboard.press("Escape")
    expect(page.get_by_role("banner")).to_be_visible()
    expect(drones(page).first).to_be_visible()
    assert "wall" not in page.url


def test_the_map_comes_back_after_the_graphics_were_lost(scripted, open_page, counted):
    page = open_page(f"{scripted}?fake=58,frozen#/live?{TOWN}", context=counted)
    page.watched.expected = ("WebGL", "webgl", "CONTEXT_LOST")
    page.wait_for_function("() => window.drawn === 12")
    page.evaluate(
        """() => {
          window.drawn = 0;
          window.lost = [...document.querySelectorAll('.map canvas')]
            .map((canvas) => canvas.getContext('webgl2')?.getExtension('WEBGL_lose_context')).filter(Boolean);
          for (const each of window.lost) each.loseContext();
        }"""
    )
    expect(page.get_by_text("The graphics of this browser have stopped.")).to_be_visible()
    page.evaluate("() => { for (const each of window.lost) each.restoreContext(); }")
    expect(page.get_by_text("The graphics of this browser have stopped.")).to_have_count(0)
    page.wait_for_function("() => window.drawn === 12")


def test_how_each_pad_does_is_told(real, open_page):
    page = open_page(real.link())
    page.get_by_role("button", name=re.compile("^Pads")).click()
    row = page.get_by_role("list", name="Pads").get_by_role("button")
    expect(row).to_contain_text("Aurajoki 2")
    expect(row).to_contain_text("never heard from")
    assert "list=pads" in page.url
    row.click()
    page.wait_for_function("() => Number(location.hash.split(',').at(-1)) > 16")


def test_verdicts_are_told_to_those_who_listen(real, open_page):
    page = open_page(real.link())
    expect(drones(page)).to_have_count(2)
    said = page.get_by_test_id("announcer")
    expect(said).to_be_empty()
    facts, now_ms = real.facts, real.now_ms()
    real.add(facts.request("three", uav_id="uav-1", t_ms=now_ms))
    real.add(facts.decide("three", uav_id="uav-1", t_ms=now_ms, outcome="inconclusive"))
    expect(said).to_have_text("uav-1: inconclusive at Aurajoki 2.")


def test_a_recording_of_a_backend_plays_without_it(real, scripted, open_page, browser, tmp_path):
    for number in range(3):
        real.hear(f"heard-{number}", 604_518_000 + number * 1_000, 222_666_000)
    out = tmp_path / "a.jsonl"
    command = [sys.executable, str(ROOT / "scripts" / "record_live.py"), real.link(), str(out), "--seconds", "2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    lines = out.read_text().splitlines()
    assert json.loads(lines[0])["frame"]["type"] == "hello"
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    context.route(re.compile(r"//[^/]+/recordings/a\.jsonl$"), lambda route: route.fulfill(body=out.read_text()))
    page = open_page(f"{scripted}?source=fake:/recordings/a.jsonl", context=context)
    expect(drones(page)).to_have_count(5)
    expect(drones(page).first).to_contain_text("Refuted at Aurajoki 2")
    expect(drones(page).filter(has_text="heard-1")).to_have_count(1)
    context.close()


def test_a_link_that_was_used_records_nothing(real, tmp_path):
    command = [sys.executable, str(ROOT / "scripts" / "record_live.py")]
    for link, code, why in (
        (f"{real.url}/#token={'0' * 43}", 1, "refused the link"),
        (real.url, 2, "no sign-in link"),
    ):
        done = subprocess.run(
            [*command, link, str(tmp_path / "a")], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == code
        assert why in done.stderr
        assert "Traceback" not in done.stderr
