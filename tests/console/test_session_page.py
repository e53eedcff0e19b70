"""One session's page, on a real backend: what shows a lie, who said what to whom, and what one can do about it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from kit.chain import number
from playwright.sync_api import expect

EVIDENCE = b'{"format":"wonderland-evidence/1"}'


@pytest.fixture
def page(real, measured, open_page):
    return open_page(real.link(), room=f"sessions/{measured}")


def test_residuals_lie_off_the_claim_and_on_the_estimate(page):
    card = page.get_by_role("region", name="Residuals")
    pattern = r"Anchor A\d: on average ([+-]\d.*?)\sm against the signed claim, ([+-]\d.*?)\sm against the estimate"
    plots = card.get_by_role("img", name=re.compile("^Anchor"))
    expect(plots).to_have_count(4)
    for plot in plots.all():
        found = re.match(pattern, plot.get_attribute("aria-label").replace("−", "-"))
        claimed, estimated = (abs(float(figure)) for figure in found.groups())
        assert claimed > 1
        assert estimated < 0.1
    card.get_by_text("The same as a table").click()
    expect(card.get_by_role("row")).to_have_count(5)


def test_the_sequence_says_who_signed_what_and_where_it_stands_on_the_ledger(measured, page):
    sequence = page.get_by_role("group", name="Step by step")
    expect(sequence.get_by_text("signed: pad-1-0")).to_have_count(2)  # the tests' chain has one creator
    expect(sequence.get_by_text("over transcript 0000…00")).to_have_count(2)
    expect(sequence.get_by_text("signature AAAA…AA")).to_be_visible()
    expect(sequence.get_by_text("signed: 0000…00")).to_be_visible()  # no certificate that the ledger has shown
    expect(sequence.get_by_text("AuthorityMSP")).to_have_count(2)
    expect(sequence.get_by_text(re.compile("^evidence [0-9a-f]{4}…"))).to_be_visible()
    links = sequence.locator("a")
    request = links.filter(has_text=f"{measured[:4]}…{measured[-2:]} · block 7")
    expect(links).to_have_count(3)  # request, verdict, and the permission that the verdict is
    request.click()
    expect(page).to_have_url(re.compile(f"#/ledger/transaction/{measured}"))
    expect(page.get_by_text("RequestProof").first).to_be_visible()


def saved_by(page, place):
    """The file that the button saves. This chain is none of a ledger's: what the server would give is put in place."""
    page.route("**/evidence", lambda route: route.fulfill(body=EVIDENCE, content_type="application/json"))
    with page.expect_download() as waiting:
        place.get_by_role("button", name="Evidence", exact=True).click()
    return waiting.value.suggested_filename, Path(waiting.value.path()).read_bytes()


def reason_to_suspend(page, place):
    place.get_by_role("link", name="Suspend…").click()
    return page.get_by_label("Reason")


def test_evidence_and_suspension_from_the_sessions_page(measured, page):
    assert saved_by(page, page) == (f"evidence-{measured[:12]}.json", EVIDENCE)
    expect(reason_to_suspend(page, page)).to_have_value(f"Refuted at Aurajoki 2: session {measured[:12]}")


def test_evidence_and_suspension_from_an_alert(real, measured, open_page):
    page = open_page(real.link(), room="alerts")
    page.get_by_role("link", name="Refuted").filter(has_text="uav-1").click()
    panel = page.get_by_role("region", name="Alerts", exact=True)
    assert saved_by(page, panel) == (f"evidence-{measured[:12]}.json", EVIDENCE)
    expect(reason_to_suspend(page, panel)).to_have_value(f"Refuted at Aurajoki 2: session {measured[:12]}")


def test_a_course_that_cannot_be_recomputed_or_fetched_says_so(real, open_page):
    """The survey that this session names is not on the ledger; then the server fails."""
    page = open_page(real.link(), room=f"sessions/{number('session', 'two')}")
    card = page.locator("section").filter(has=page.get_by_role("heading", name="How it was decided"))
    expect(card.get_by_role("status")).to_contain_text("There is the verdict alone")
    page.watched.expected = ("500",)
    page.route("**/course", lambda route: route.fulfill(status=500, json={"detail": "Out of order."}))
    page.reload()
    expect(card.get_by_role("alert")).to_have_text("Out of order.")
