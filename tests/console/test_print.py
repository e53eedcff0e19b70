"""What is printed from a dark screen: dark ink on white paper, and the charts' figures where nobody can unfold them."""

from __future__ import annotations

import datetime as dt

import pytest
from playwright.sync_api import expect

LUMINANCE = """(element) => {
  const parts = getComputedStyle(element).color.match(/[\\d.]+/g).slice(0, 3).map(Number);
  return (0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]) / 255;
}"""
PAGES = {
    "session": ("sessions/{session}", "How it was decided"),
    "verdicts": ("verdicts", "Refuted"),
    "report": ("statistics?day={day}", "Verdicts over time"),
}


@pytest.mark.parametrize("name", PAGES)
def test_a_dark_screen_prints_dark_on_white(real, measured, open_page, name):
    place, words = PAGES[name]
    day = dt.datetime.now(dt.UTC).date().isoformat()
    page = open_page(real.link(), room=place.format(session=measured, day=day), theme="dark")
    expect(page.locator("main :is(h2, td)").filter(has_text=words).first).to_be_visible()
    ground = "getComputedStyle(document.body).getPropertyValue('--panel')"
    assert page.evaluate(ground) == "#161b1d"
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate(ground) == "#fff"
    inks = page.locator("main :is(h1, h2, td, th, p, dd, dt, svg text):visible").all()
    assert len(inks) > 10
    assert max(ink.evaluate(LUMINANCE) for ink in inks) < 0.5
    for table in page.locator(".as-table table").all():
        expect(table).to_be_visible()
    assert page.pdf(print_background=True).startswith(b"%PDF")


def test_the_live_map_prints_its_map_light_and_its_list(real, open_page):
    page = open_page(real.link(), room="live", theme="dark")
    expect(page.get_by_role("listbox", name="Drones").get_by_role("option")).to_have_count(2)
    page.wait_for_load_state("networkidle")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print", color_scheme="dark")
    paper = page.locator(".map-print")
    width, height = (paper.bounding_box()[each] for each in ("width", "height"))
    assert width > 700
    assert height > 300
    light = """(canvas) => {
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      let sum = 0;
      for (let i = 0; i < data.length; i += 4) sum += data[i];
      return sum / (data.length / 4);
    }"""
    assert paper.evaluate(light) > 200
    rows = page.get_by_role("option").all()
    assert all(row.bounding_box()["y"] >= height for row in rows), "the list lies on the map"
    assert max(row.locator("b").first.evaluate(LUMINANCE) for row in rows) < 0.5
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    expect(paper).to_have_count(0)
