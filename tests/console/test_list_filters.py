"""The filters of sessions and verdicts in Chromium on a real backend: they combine, and stand in the address."""

from __future__ import annotations

import re
from datetime import datetime, timedelta

import pytest
from playwright.sync_api import expect

ROOMS = ("sessions", "verdicts")


def rows(page):
    return page.get_by_role("table").locator("tbody tr")


def filters(page):
    return page.get_by_role("group", name="Filters")


@pytest.mark.parametrize("room", ROOMS)
def test_filters_combine_stay_in_the_address_and_are_cleared_at_once(real, open_page, room):
    page = open_page(real.link(), room=room)
    expect(rows(page)).to_have_count(2)
    bar = filters(page)
    expect(bar.get_by_role("button", name="Clear filters")).to_have_count(0)
    bar.get_by_label("Outcome").select_option("refuted")
    expect(rows(page)).to_have_count(1)
    expect(rows(page)).to_contain_text("uav-2")
    bar.get_by_label("Pad").select_option("pad-1")
    bar.get_by_label("Action").select_option("land")
    bar.get_by_label("Operator").fill("fleet")
    bar.get_by_label("Drone").fill("uav-2")
    expect(page).to_have_url(re.compile(f"#/{room}\\?.*drone=uav-2"))
    expect(rows(page)).to_have_count(1)
    assert all(part in page.url for part in ("outcome=refuted", "pad=pad-1", "action=land", "operator=fleet"))
    page.reload()
    expect(rows(page)).to_have_count(1)
    expect(bar.get_by_label("Operator")).to_have_value("fleet")

    bar.get_by_label("Drone").fill("uav-1")
    expect(page.get_by_text(re.compile("^No (session|verdict) fits these filters.$"))).to_be_visible()
    bar.get_by_role("button", name="Clear filters").click()
    expect(rows(page)).to_have_count(2)
    expect(bar.get_by_label("Drone")).to_have_value("")
    assert "?" not in page.url


@pytest.mark.parametrize("room", ROOMS)
def test_days_are_those_of_this_browser(real, open_page, room):
    page = open_page(real.link(), room=room)
    # The proofs are half a minute and a minute old: of today, or just before midnight.
    first, last = ((datetime.now().astimezone() + timedelta(days=days)).date().isoformat() for days in (-1, 1))
    bar = filters(page)
    bar.get_by_label("From").fill(first)
    expect(page).to_have_url(re.compile(f"since={first}"))
    expect(rows(page)).to_have_count(2)
    bar.get_by_label("From").fill(last)
    expect(rows(page)).to_have_count(0)
    bar.get_by_role("button", name="Clear filters").click()
    bar.get_by_label("Until").fill(first)
    expect(page).to_have_url(re.compile(f"until={first}"))


def test_sessions_are_filtered_by_how_far_they_have_come(real, open_page):
    real.add(real.facts.request("three", t_ms=real.now_ms()))
    page = open_page(real.link(), room="sessions")
    expect(rows(page)).to_have_count(3)
    filters(page).get_by_label("State").select_option("requested")
    expect(rows(page)).to_have_count(1)
    expect(rows(page)).to_contain_text("Being proved")
    # Back from a session the list is as it was.
    rows(page).get_by_role("link").first.click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Sessions /")
    page.go_back()
    expect(filters(page).get_by_label("State")).to_have_value("requested")


@pytest.mark.parametrize("room", ROOMS)
def test_a_filter_that_makes_no_sense_is_no_empty_list(real, open_page, room):
    page = open_page(real.link(), room=f"{room}?outcome=handsome")
    page.watched.expected = ("422",)
    expect(page.get_by_role("alert").filter(has=page.get_by_role("button", name="Try again"))).to_be_visible()
    expect(page.get_by_text("fits these filters")).to_have_count(0)
    filters(page).get_by_role("button", name="Clear filters").click()
    expect(rows(page)).to_have_count(2)


def test_older_pages_are_filtered_too(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/verdicts?outcome=verified")
    expect(rows(page)).to_have_count(50)
    page.get_by_role("button", name="Older").click()
    expect(rows(page)).not_to_have_count(50)
    expect(rows(page).filter(has_text="Verified")).to_have_count(rows(page).count())
