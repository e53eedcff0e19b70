"""The built console in Chromium on a real backend, which mirrors real blocks."""

from __future__ import annotations

import re

import pytest
from kit.facts import FRAME
from playwright.sync_api import expect

# The browser itself reports these; the page says the same in its banner.
LOST = ("WebSocket connection to", "ERR_CONNECTION_REFUSED", "Failed to load resource")
REFUSED = ("401 (Unauthorized)",)


def rows(page):
    return page.get_by_role("option")


@pytest.fixture
def signed_in(real, open_page):
    page = open_page(real.link())
    expect(rows(page)).to_have_count(2)
    return page


def test_a_link_signs_in_once_and_leaves_no_trace_in_the_address(real, open_page):
    link = real.link()
    page = open_page(link)
    expect(page.get_by_text("In the air")).to_be_visible()
    assert "token" not in page.url
    expect(page.get_by_text("Embedded ledger, no multi-party trust")).to_be_visible()
    expect(page.get_by_text("3 organisations · 6 blocks · up to date")).to_be_visible()
    page.reload()
    expect(page.get_by_text("In the air")).to_be_visible()

    other = open_page(link)
    other.watched.expected = REFUSED
    expect(other.get_by_role("alert")).to_have_text("This link has been used before, or is too old.")
    expect(other.get_by_text("wonderland backend link")).to_be_visible()


def test_without_a_link_it_says_how_to_get_one(real, open_page):
    page = open_page(f"{real.url}/verdicts")
    page.watched.expected = (*REFUSED, "403 (Forbidden)")
    expect(page.get_by_role("heading", name="Wonderland")).to_be_visible()
    expect(page.get_by_text("Open the link that it printed when it started")).to_be_visible()
    real.link()  # somebody has an account now
    page.reload()
    expect(page.get_by_text("An administrator can send you a link.")).to_be_visible()
    assert page.get_by_text("uav-").count() == 0


def test_signing_out_ends_it(signed_in):
    signed_in.watched.expected = REFUSED
    signed_in.get_by_role("button", name="Sign out").click()
    expect(signed_in.get_by_text("Is it where it says?")).to_be_visible()
    signed_in.reload()
    expect(signed_in.get_by_text("Is it where it says?")).to_be_visible()


def test_a_page_tells_when_somebody_is_at_the_keys_and_only_then(signed_in):
    told = []
    signed_in.on(
        "request", lambda request: told.append(request.method) if request.url.endswith("/session/use") else None
    )
    with signed_in.expect_request("**/api/v1/status"):
        pass  # what the page asks by itself
    assert told == []
    with signed_in.expect_response("**/api/v1/session/use") as answer:
        rows(signed_in).first.click()
    assert answer.value.status == 204
    rows(signed_in).last.click()
    signed_in.keyboard.press("v")
    expect(signed_in.get_by_role("table")).to_be_visible()
    assert told == ["POST"], "once a minute is enough"


def test_a_display_is_signed_in_by_its_link(real, open_page):
    page = open_page(real.link("Control room", "viewer", kind="display"))
    expect(page.get_by_role("link", name="Control room")).to_be_visible()
    page.keyboard.press("w")
    expect(page.get_by_role("region", name="Wall display")).to_be_visible()


def test_what_needs_the_officer_comes_first_and_is_told_in_words(signed_in):
    first = rows(signed_in).first
    expect(first).to_contain_text("uav-2")
    expect(first).to_contain_text("Refuted at Aurajoki 2 · landing refused")
    first.click()
    panel = signed_in.get_by_role("region", name="Proof")
    expect(panel.get_by_role("heading", level=2)).to_have_text("Refuted")
    expect(panel.locator(".told p")).to_contain_text("uav-2 says it is over Aurajoki 2")
    expect(panel.get_by_text("1 Request on the ledger")).to_be_visible()
    assert re.search(r"drone=uav-2", signed_in.url)


def test_a_proof_fills_in_while_one_looks(real, signed_in):
    facts, now_ms = real.facts, real.now_ms()
    place = FRAME
    real.hear("uav-1", place["lat_e7"] + 900, place["lon_e7"])
    real.add(facts.request("three", uav_id="uav-1", t_ms=now_ms))
    row = rows(signed_in).filter(has_text="uav-1")
    expect(row).to_contain_text("step 2 of 8")
    row.click()
    panel = signed_in.get_by_role("region", name="Proof")
    expect(panel.get_by_role("heading", level=2)).to_have_text("Being proved")
    real.add(facts.decide("three", uav_id="uav-1", t_ms=now_ms))
    expect(panel.get_by_role("heading", level=2)).to_have_text("Verified")
    expect(panel.get_by_text("8 Permission to land · granted")).to_be_visible()
    expect(row).to_contain_text("landing permitted")
    real.add(facts.complete("three", uav_id="uav-1", t_ms=now_ms))
    expect(row).to_contain_text("landed")


def test_a_server_that_went_away_is_told_and_what_happened_meanwhile_is_not_lost(real, signed_in):
    signed_in.watched.expected = LOST
    real.stop()
    banner = signed_in.get_by_role("alert")
    expect(banner).to_contain_text("Not connected")
    facts, now_ms = real.facts, real.now_ms()
    real.add(facts.put_uav("uav-3"), facts.request("four", uav_id="uav-3", t_ms=now_ms))
    real.add(facts.decide("four", uav_id="uav-3", t_ms=now_ms, outcome="inconclusive"))
    real.start()
    expect(rows(signed_in).filter(has_text="uav-3")).to_contain_text("Inconclusive at Aurajoki 2")
    expect(banner).to_have_count(0)


def test_a_ledger_that_contradicts_itself_is_told_loudly(real, signed_in):
    real.contradict()
    expect(signed_in.get_by_role("alert")).to_contain_text("mirror halted")
    expect(signed_in.get_by_text("mirror halted", exact=False).first).to_be_visible()


def test_verdicts_are_a_table_that_can_be_filtered(real, signed_in):
    signed_in.keyboard.press("v")
    table = signed_in.get_by_role("table")
    expect(table.get_by_role("row")).to_have_count(3)
    signed_in.get_by_label("Outcome").select_option("refuted")
    expect(table.get_by_role("row")).to_have_count(2)
    expect(table).to_contain_text("uav-2")
    assert "outcome=refuted" in signed_in.url
    signed_in.reload()
    expect(signed_in.get_by_role("table").get_by_role("row")).to_have_count(2)
    signed_in.watched.expected = ("422",)
    signed_in.get_by_label("Drone").fill("no such serial number!")
    signed_in.keyboard.press("Enter")
    expect(signed_in.get_by_role("alert")).to_contain_text("not allowed")
    assert real.backend is not None


def test_a_session_shows_its_steps_ranges_and_transactions(signed_in):
    signed_in.keyboard.press("s")
    signed_in.get_by_role("link", name="Refuted").click()
    expect(signed_in.get_by_text("RequestProof")).to_be_visible()
    submit = signed_in.get_by_role("row").filter(has_text="SubmitProof")
    expect(submit).to_contain_text("AuthorityMSP, PadMSP")
    expect(submit).to_contain_text("VALID")
    expect(signed_in.get_by_role("img", name=re.compile(r"Anchor A0: median 4.0. m, 3 of 3 rounds"))).to_be_visible()
    signed_in.get_by_role("link", name="Show on the map").click()
    expect(signed_in.get_by_role("region", name="Proof")).to_contain_text("Refuted")


def test_names_from_the_ledger_are_text_and_nothing_else(real, signed_in):
    name = '<img src=x onerror="document.title=1">'
    real.add(real.facts.put_pad(name=name))
    expect(rows(signed_in).first).to_contain_text(f"Refuted at {name}")
    rows(signed_in).first.click()
    expect(signed_in.get_by_role("region", name="Proof")).to_contain_text(name)
    assert signed_in.title() == "Wonderland"
