"""The ledger room in Chromium on a real backend: blocks, transactions in full, and hashes recomputed in the browser."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect


@pytest.fixture
def ledger(real, open_page):
    page = open_page(real.link(), room="ledger")
    expect(page.get_by_role("heading", name="Ledger", exact=True)).to_be_visible()
    return page


def test_a_key_leads_there_from_the_map(real, open_page):
    page = open_page(real.link())
    expect(page.get_by_role("option")).to_have_count(2)
    page.keyboard.press("e")
    expect(page.get_by_role("heading", name="Ledger", exact=True)).to_be_visible()


def test_the_chain_is_recomputed_in_the_browser(ledger):
    expect(ledger.get_by_test_id("ledger-summary")).to_contain_text("gives no multi-party trust")
    expect(ledger.get_by_role("table").get_by_role("row")).to_have_count(7)
    ledger.get_by_role("button", name="Check the chain").click()
    expect(ledger.get_by_role("status")).to_contain_text("All 6 blocks follow one another")


def test_a_server_that_changes_a_block_is_found_out(ledger):
    def forge(route):
        answer = route.fetch()
        page = answer.json()
        page["items"][2]["data_hash"] = "0" * 64
        route.fulfill(response=answer, json=page)

    ledger.route("**/api/v1/blocks?*", forge)
    ledger.get_by_role("button", name="Check the chain").click()
    expect(ledger.get_by_role("status")).to_contain_text("Block 3 does not have the hash that it claims")


def test_from_a_block_to_its_transaction_in_full(ledger):
    ledger.get_by_role("row").nth(2).get_by_role("link").first.click()
    expect(ledger.get_by_role("heading", name="Ledger / Block 4")).to_be_visible()
    ledger.get_by_role("button", name="Check against the bytes").click()
    expect(ledger.get_by_role("status")).to_contain_text("hash to what its header says")
    expect(ledger.get_by_role("status")).to_contain_text("names the block before it")
    ledger.get_by_role("table").get_by_role("link").first.click()
    expect(ledger.get_by_text("Valid: its writes count.")).to_be_visible()
    expect(ledger.get_by_text("peer-", exact=False).first).to_be_visible()
    expect(ledger.locator("pre").first).to_contain_text('"pad_id":"pad-1"')


def test_no_number_of_an_operator_is_in_what_a_registration_wrote(ledger):
    ledger.get_by_role("row").nth(5).get_by_role("link").first.click()
    ledger.get_by_role("table").get_by_role("link", name="RegisterUav").first.click()
    expect(ledger.get_by_text("Valid: its writes count.")).to_be_visible()
    writes = ledger.locator("details")
    expect(writes.first).to_be_visible()
    for write in writes.all():
        write.click()
    expect(ledger.locator("main")).to_contain_text("registration_commitment")
    expect(ledger.locator("main")).not_to_contain_text("FIN")
    expect(ledger.locator("main")).not_to_contain_text("Shown in part")


def test_from_a_session_to_its_evidence_on_the_ledger_and_back(ledger):
    ledger.keyboard.press("s")
    ledger.get_by_role("link", name="Refuted").click()
    ledger.get_by_role("link", name="SubmitProof").click()
    expect(ledger.get_by_role("heading", name="Ledger / SubmitProof")).to_be_visible()
    expect(ledger.locator("pre").first).to_contain_text('"evidence"')
    expect(ledger.get_by_text("Event · ProofDecided")).to_be_visible()
    ledger.get_by_role("link", name="Show the session").click()
    expect(ledger.get_by_role("heading", level=2).first).to_have_text("Refuted")


def test_bytes_that_are_not_those_of_the_header_are_found_out(ledger):
    ledger.route("**/api/v1/blocks/*/data", lambda route: route.fulfill(body=b"other bytes"))
    ledger.get_by_role("row").nth(2).get_by_role("link").first.click()
    ledger.get_by_role("button", name="Check against the bytes").click()
    expect(ledger.get_by_role("status")).to_contain_text("do NOT have the hash")


def test_a_row_that_was_edited_in_the_database_is_shown_and_alerted(real, ledger):
    shown = ledger.get_by_test_id("rows-checked")
    expect(shown).to_have_text("not yet")
    real.compare_rows()
    expect(shown).to_contain_text("equal, ")
    real.compare_rows("UPDATE verdicts SET outcome = 'verified' WHERE outcome = 'refuted'")
    expect(shown).to_contain_text("1 row differs")
    expect(ledger.get_by_text("changed behind the ledger’s back")).to_be_visible(timeout=15_000)
