"""The console's pages in Chromium on its scripted world."""

from __future__ import annotations

import io
import re
import time

import pytest
from PIL import Image
from playwright.sync_api import expect

MAP_ONLY = {"x": 400, "y": 60, "width": 860, "height": 590}
SCALES = {"country": "60.5,22.3,5.6", "town": "60.445,22.255,13", "pad": "60.45148,22.26868,20"}
PATIENCE_S = 45
"""Coasts are 7 MB, and drawn by software."""


def at_rest(page):
    """Waits until the map has drawn what it has."""
    expect(page.get_by_role("option").first).to_be_visible()
    page.wait_for_function("document.querySelector('.maplibregl-canvas') !== null")
    page.wait_for_timeout(300)


def colours(page, clip):
    """How many colours there are in a part of the picture."""
    image = Image.open(io.BytesIO(page.screenshot(clip=clip)))
    return len(image.convert("RGB").getcolors(1 << 24))


@pytest.mark.parametrize("scale", SCALES)
def test_the_map_draws_from_the_country_to_the_pad(scripted, open_page, scale):
    page = open_page(f"{scripted}?fake=58,frozen#/live?at={SCALES[scale]}")
    at_rest(page)
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        # Beside the panels, where only the map is: an empty one has a single colour. Each picture makes the browser draw.
        begin = time.monotonic()
        while colours(page, MAP_ONLY) <= 20 or page.evaluate("document.documentElement.dataset.theme") != theme:
            assert time.monotonic() - begin < PATIENCE_S, f"the map stays empty in the {theme} theme"
            page.wait_for_timeout(250)
    grid = page.get_by_test_id("grid")
    if scale == "country":
        expect(grid).to_have_count(0)
    else:
        expect(grid).to_have_text("500 m" if scale == "town" else "5 m")


def test_the_list_is_gone_through_by_keys_and_the_address_holds_the_choice(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen")
    at_rest(page)
    page.get_by_role("listbox").focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    panel = page.get_by_role("region", name="Proof")
    expect(panel).to_contain_text("OH-DRN-0640 says it is 7.4 m south-west of Kupittaa")
    expect(panel).to_contain_text("Somebody broadcasts its serial number 31 m from where it was measured")
    page.wait_for_url(re.compile(r"#/live\?drone=OH-DRN-0640&at="))
    # Close enough to tell square metres.
    page.wait_for_function("Number(location.hash.split(',').at(-1)) > 18")
    camera = page.url.split("at=")[1]
    page.reload()
    at_rest(page)
    expect(page.get_by_role("region", name="Proof")).to_contain_text("OH-DRN-0640")
    page.wait_for_timeout(1_000)
    assert page.url.split("at=")[1] == camera
    page.keyboard.press("Escape")
    expect(page.get_by_role("region", name="Proof")).to_have_count(0)


def test_a_press_on_a_drone_selects_it(scripted, open_page):
    # OH-DRN-0377 stands docked in the middle of its pad, on which the camera looks.
    page = open_page(f"{scripted}?fake=58,frozen#/live?at=60.43552,22.21874,19")
    at_rest(page)
    page.wait_for_timeout(1_500)
    boxes = page.evaluate(
        """() => ['.live', '.list', '.strip-panel'].map((s) => {
             const { x, y, width, height } = document.querySelector(s).getBoundingClientRect();
             return { x, y, width, height };
           })"""
    )
    live, drones, strip = boxes
    left, right = drones["x"] + drones["width"] + 12, live["x"] + live["width"] - 12
    top, bottom = live["y"] + 12, live["y"] + live["height"] - (strip["height"] + 24 + 40)
    page.mouse.click((left + right) / 2, (top + bottom) / 2)
    expect(page.get_by_role("region", name="Proof")).to_contain_text("OH-DRN-0377")


def test_both_claims_steps_and_reasons_are_there(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/live?drone=OH-DRN-0640")
    panel = page.get_by_role("region", name="Proof")
    expect(panel.get_by_text("Signed for the pad:")).to_be_visible()
    claims = panel.get_by_role("listitem")
    expect(claims.filter(has_text="Signed for the pad:")).to_contain_text("verified")
    expect(claims.filter(has_text="Impersonation or lie.")).to_contain_text("31.0 m from where it was measured")
    expect(
        panel.get_by_text("Somebody broadcasts its serial number 31.0 m from where it was measured")
    ).to_be_attached()
    for number in range(1, 9):
        expect(panel.get_by_role("listitem").filter(has_text=re.compile(rf"^{number} "))).to_have_count(1)
    plot = panel.get_by_role("img", name=re.compile("Plot of the pad"))
    words = plot.get_attribute("aria-label").replace("\xa0", " ")
    assert "signed claim: 4.1 m south, 6.2 m west of the pad; broadcast, can mean 2 m: 16 m north, 18 m east" in words


def test_what_is_not_from_the_ledger_says_so(scripted, open_page):
    page = open_page(f"{scripted}?fake=55,frozen#/live?drone=OH-DRN-0118")
    panel = page.get_by_role("region", name="Proof")
    expect(panel.get_by_role("heading", level=2)).to_have_text("Being proved")
    expect(panel.locator(".figures")).to_contain_text("unverified")
    page.goto(f"{scripted}?fake=58,frozen#/live?drone=SE-UAS-7715")
    expect(panel.get_by_role("heading", level=2)).to_have_text("Out of range")
    expect(panel).to_contain_text("Nobody has checked it.")
    expect(panel.locator(".tag")).to_have_text("unverified")


def test_the_strip_leads_to_the_gravest_verdict_of_its_half_minute(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen")
    at_rest(page)
    page.locator(".strip-bins button:not(:disabled)[aria-label*=refuted]").first.click()
    expect(page.get_by_role("region", name="Proof").get_by_role("heading", level=2)).to_have_text("Refuted")
    assert re.search(r"session=[0-9a-f]{64}", page.url)


def test_help_theme_and_rooms_by_key(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen")
    at_rest(page)
    page.keyboard.press("?")
    help_dialog = page.get_by_role("dialog", name="Keys")
    expect(help_dialog).to_be_visible()
    page.keyboard.press("v")  # not while the dialog is open
    page.keyboard.press("Escape")
    expect(help_dialog).to_be_hidden()
    expect(page).to_have_url(re.compile("#/live"))  # written a moment after the map came to rest
    theme = "document.documentElement.dataset.theme"
    page.keyboard.press("t")
    assert page.evaluate(theme) == "dark"
    page.reload()
    at_rest(page)
    assert page.evaluate(theme) == "dark"
    page.keyboard.press("s")
    expect(page.get_by_role("heading", level=1)).to_have_text("Sessions")
    page.keyboard.press("l")
    expect(page.get_by_text("In the air")).to_be_visible()


@pytest.mark.parametrize(
    ("flag", "words"),
    [
        ("lost", "Not connected: the server cannot be reached."),
        ("halted", "mirror halted"),
        ("lagging", "14 s behind the ledger"),
    ],
)
def test_the_banner_says_what_is_not_true_just_now(scripted, open_page, flag, words):
    page = open_page(f"{scripted}?fake=58,{flag}")
    expect(page.get_by_role("alert")).to_contain_text(words)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_phone_has_sheets_and_nothing_beyond_its_edge(scripted, open_page, theme):
    page = open_page(f"{scripted}?fake=58,frozen", width=390, height=844, theme=theme)
    at_rest(page)
    sheet = page.get_by_role("region", name="In the air")
    tall = sheet.bounding_box()["height"]
    page.get_by_role("button", name="Fold the list of drones").click()
    assert sheet.bounding_box()["height"] < tall / 2
    page.get_by_role("button", name="Unfold the list of drones").click()
    page.get_by_role("option").first.click()
    panel = page.get_by_role("region", name="Proof")
    expect(panel).to_contain_text("Refuted")
    expect(sheet).to_have_count(0)
    for room in ("Sessions", "Verdicts", "Live"):
        page.get_by_role("link", name=room, exact=True).click()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
    notice = page.get_by_test_id("ledger-notice")
    expect(notice.get_by_text("Embedded", exact=True)).to_be_visible()
    expect(notice).to_have_attribute("title", re.compile("no multi-party trust"))


def test_panels_can_be_made_wider_and_stay_so(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen")
    at_rest(page)
    separator = page.get_by_role("separator", name="Width of the list")
    separator.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    region = page.get_by_role("region", name="In the air")
    assert round(region.bounding_box()["width"]) == 316 + 32
    page.reload()
    at_rest(page)
    assert round(region.bounding_box()["width"]) == 316 + 32


def test_older_pages_come_when_asked_for(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/verdicts")
    body = page.get_by_role("table").locator("tbody tr")
    expect(body).to_have_count(50)
    page.get_by_role("button", name="Older").click()
    expect(body).to_have_count(100)
