"""The search box in Chromium on a real backend."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect


@pytest.fixture
def page(real, open_page):
    opened = open_page(real.link())
    expect(opened.get_by_role("option")).to_have_count(2)
    return opened


def test_a_drone_by_its_registration_with_the_keyboard_alone(page):
    page.keyboard.press("/")
    box = page.get_by_role("combobox", name="Search")
    expect(box).to_be_focused()
    box.press_sequentially("fin87astrdge12k8")
    hits = page.get_by_role("search").get_by_role("option")
    expect(hits).to_have_count(2)
    page.keyboard.press("ArrowDown")
    expect(hits.nth(1)).to_have_attribute("aria-selected", "true")
    page.keyboard.press("Enter")
    expect(page.get_by_role("region", name="Proof")).to_be_visible()
    assert "drone=uav-2" in page.url


def test_a_transaction_by_its_first_digits(page):
    tx_id = page.evaluate("fetch('/api/v1/verdicts').then((r) => r.json()).then((r) => r.items[0].tx_id)")
    page.get_by_role("combobox", name="Search").fill(tx_id[:10])
    page.get_by_role("search").get_by_role("option").filter(has_text="SubmitProof").click()
    expect(page.get_by_text("Valid: its writes count.")).to_be_visible()


def test_what_does_not_exist_is_said_as_text(page):
    box = page.get_by_role("combobox", name="Search")
    box.fill("<img src=x onerror=alert(1)>")
    expect(page.get_by_role("search").get_by_role("status")).to_contain_text("Nothing fits “<img")
    box.press("Escape")
    expect(box).to_have_value("")
