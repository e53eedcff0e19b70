"""The statistics in Chromium on a real backend and ledger: the figures are the API's, of proofs that were made."""

from __future__ import annotations

import re
from datetime import datetime, timedelta

from kit.houses import HONEST, LIAR
from playwright.sync_api import expect


def figure(page, name):
    return page.locator(".totals > div").filter(has=page.get_by_text(name, exact=True)).locator("dd").first


def test_the_figures_are_those_of_what_happened(with_liar, open_page):
    anna = with_liar.person("Anna Officer", "inspector")
    now_ms = with_liar.now_ms()
    found = anna.get("/statistics", params={"since_ms": now_ms - 3_600_000, "until_ms": now_ms, "bin_ms": 3_600_000})
    total = found.json()["total"]
    verdicts = {each["uav_id"]: each["outcome"] for each in anna.get("/verdicts").json()["items"]}
    assert verdicts == {HONEST: "verified", LIAR: "refuted"}
    assert (total["verified"], total["refuted"], total["inconclusive"]) == (1, 1, 0)

    page = open_page(with_liar.link(), room="statistics?span=hour")
    for name, count in (
        ("Verdicts", 2),
        ("Verified", total["verified"]),
        ("Refuted", total["refuted"]),
        ("Inconclusive", total["inconclusive"]),
        ("Permissions", total["granted"]),
    ):
        expect(figure(page, name)).to_have_text(str(count))
    expect(page.get_by_role("img", name=re.compile("1 verified, 0 inconclusive, 1 refuted from"))).to_be_visible()

    page.locator(".filters").get_by_label("Pad").select_option("pad-0")
    expect(figure(page, "Verdicts")).to_have_text("2")
    page.get_by_label("Action").select_option("takeoff")
    expect(page.get_by_text("No verdict in this span.")).to_be_visible()


def test_the_report_of_a_day(with_liar, open_page):
    page = open_page(with_liar.link(), room="statistics")
    page.get_by_label("Span of time").select_option("other")
    expect(page.get_by_role("heading", level=1)).to_contain_text("Daily report")
    expect(figure(page, "Verdicts")).to_have_text("2")
    today = datetime.now().astimezone().date()
    assert f"day={today}" in page.url
    page.locator("input[type=date]").fill(str(today - timedelta(days=1)))
    expect(page.get_by_text("No verdict in this span.")).to_be_visible()
