"""The live map's filters in Chromium on a real backend: list, count and address say the same."""

from __future__ import annotations

import pytest
from kit.facts import FRAME
from playwright.sync_api import expect

OPERATOR = "FIN87astr---"


@pytest.fixture
def page(real, open_page):
    place = FRAME
    opened = open_page(real.link(), room="live?table")
    real.hear("uav-2", place["lat_e7"], place["lon_e7"], operator_id=OPERATOR)
    real.hear("uav-9", place["lat_e7"] + 900, place["lon_e7"])
    expect(rows(opened)).to_have_count(3)
    opened.get_by_role("button", name="Filter", exact=True).click()
    return opened


def rows(page):
    return page.get_by_role("listbox").get_by_role("option")


def test_what_is_filtered_by(page):
    for label, choice, address, left in (
        ("Operator, as broadcast", OPERATOR, f"operator={OPERATOR}", ["uav-2"]),
        ("Action", "land", "action=land", ["uav-2", "uav-1"]),
        ("Action", "takeoff", "action=takeoff", []),
        ("State", "refuted", "look=refuted", ["uav-2"]),
        ("Pad", "pad-1", "pad=pad-1", ["uav-2", "uav-1", "uav-9"]),
    ):
        page.get_by_role("group", name="Filter").get_by_label(label).select_option(choice)
        expect(page.get_by_text(f"{len(left)} of 3 shown")).to_be_visible()
        expect(rows(page)).to_contain_text(left)
        assert address in page.url
        page.get_by_role("button", name="Show all").click()
        expect(rows(page)).to_have_count(3)


def test_what_was_decided_long_ago_is_left_out(page):
    """uav-1 was decided a minute ago, uav-2 half of that; uav-9 was only heard."""
    time = page.get_by_role("group", name="Filter").get_by_label("Time")
    time.select_option("1")
    expect(page.get_by_text("2 of 3 shown")).to_be_visible()
    expect(rows(page)).to_contain_text(["uav-2", "uav-9"])
    assert "minutes=1" in page.url
    page.reload()
    expect(page.get_by_text("2 of 3 shown")).to_be_visible()
    page.get_by_role("button", name="Filter", exact=True).click()
    time.select_option("5")
    expect(page.get_by_text("3 of 3 shown")).to_be_visible()
