"""The settings hold in this browser and are seen everywhere; the tour leads through the rooms."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect


def test_language_units_and_coordinates_are_chosen_and_kept(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/settings")
    example = page.get_by_role("status").filter(has_text="So it reads")
    expect(example).to_contain_text("60.45183")
    page.get_by_role("radio", name="Degrees, minutes, seconds").check()
    page.get_by_role("radio", name="Feet").check()
    expect(example).to_contain_text("60° 27")
    expect(example).to_contain_text("ft")
    page.get_by_role("radio", name="Suomi").check()
    expect(page.get_by_role("heading", name="Asetukset")).to_be_visible()
    page.reload()
    expect(page.get_by_role("radio", name="Jalat")).to_be_checked()


@pytest.mark.parametrize("theme", ["Light", "Dark"])
def test_the_theme_is_chosen(scripted, open_page, theme):
    page = open_page(f"{scripted}?fake=58,frozen#/settings")
    page.get_by_role("radio", name=theme).check()
    expect(page.locator("html")).to_have_attribute("data-theme", theme.lower())


def test_the_tour_goes_through_the_rooms_and_ends_where_one_wants(scripted, open_page):
    page = open_page(f"{scripted}?fake=58,frozen#/settings")
    page.get_by_role("button", name="Show the tour again").click()
    card = page.locator(".tour")
    expect(card).to_contain_text("1 of 7")
    # Its first stop shows a lie: a drone is chosen, and looked at from close by.
    expect(page.get_by_role("region", name="Proof")).to_contain_text("Refuted")
    page.wait_for_function("Number(location.hash.split('at=')[1]?.split(',')[2]) > 18")
    covered = page.evaluate(
        """() => {
          const a = document.querySelector('.tour').getBoundingClientRect();
          return [...document.querySelectorAll('.map-tools > *, .map-credits > *, .panel')].filter((element) => {
            const b = element.getBoundingClientRect();
            return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
          }).length;
        }"""
    )
    assert covered == 0
    for stop, room in ((2, "live"), (3, "verdicts"), (4, "sessions"), (5, "ledger"), (6, "alerts"), (7, "live")):
        card.get_by_role("button", name="Next").click()
        expect(card).to_contain_text(f"{stop} of 7")
        expect(page).to_have_url(re.compile(f"#/{room}"))
    card.get_by_role("button", name="Back").click()
    expect(card).to_contain_text("6 of 7")
    page.keyboard.press("Escape")
    expect(card).to_have_count(0)


def test_a_demo_offers_the_tour_until_it_was_taken_or_declined(console_house, open_page):
    page = open_page(console_house.link(), room="settings")
    page.get_by_role("button", name="New here? Take the tour").click()
    card = page.locator(".tour")
    expect(card).to_contain_text("1 of 7")
    card.get_by_role("button", name="End the tour").click()
    expect(card).to_have_count(0)
    page.reload()
    expect(page.get_by_test_id("ledger-notice")).to_be_visible()
    expect(page.get_by_role("button", name="New here? Take the tour")).to_have_count(0)


def test_a_server_that_is_no_demo_offers_no_tour(real, open_page):
    page = open_page(real.link(), room="settings")
    expect(page.get_by_test_id("ledger-notice")).to_be_visible()
    expect(page.get_by_role("button", name="New here? Take the tour")).to_have_count(0)
