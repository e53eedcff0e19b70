"""A browser whose clock is an hour off: ages, what is stale and what is asleep go by the server's clock."""

from __future__ import annotations

import re

import pytest
from kit.facts import FRAME
from playwright.sync_api import expect

HOUR_MS = 3_600_000


@pytest.mark.parametrize("real", [-HOUR_MS, HOUR_MS], indirect=True, ids=["browser ahead", "browser behind"])
def test_ages_and_what_is_stale_go_by_the_servers_clock(real, open_page):
    page = open_page(real.link(), room="live?table")
    place = FRAME
    real.hear("uav-1", place["lat_e7"], place["lon_e7"])

    rows = page.get_by_role("listbox").get_by_role("option")
    expect(rows.filter(has_text="uav-2").locator(".row-age")).to_have_text(re.compile(r"^[3-5]\d\ss$"))
    heard = page.get_by_role("row").filter(has_text="uav-1").get_by_role("cell").last
    expect(heard).to_have_text(re.compile(r"^(now|\d\ss)$"))
    expect(page.get_by_text("up to date")).to_be_visible()
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(page.locator(".strip-panel")).to_contain_text("2 verdicts")

    page.keyboard.press("a")
    row = page.get_by_role("link", name="Refuted")
    expect(row).to_contain_text(re.compile(r"[3-9]\d\ss|1\smin"))
    row.click()
    page.get_by_label("Snooze").select_option("15")
    expect(page.get_by_text("asleep until")).to_be_visible()
    expect(page.get_by_test_id("alerts-chip")).to_have_count(0)
    until = page.evaluate("fetch('/api/v1/alerts').then((r) => r.json()).then((r) => r.items[0].snoozed_until_ms)")
    assert abs(until - real.now_ms() - 15 * 60_000) < 60_000
