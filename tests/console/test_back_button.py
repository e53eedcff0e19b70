"""The back button leads to where one was: the same list, the same filter; in Chromium on a real backend and ledger."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import expect

ZONES = Path(__file__).resolve().parents[1] / "zones" / "files" / "turku.ed318.json"


def test_in_and_back_again_in_every_room(with_liar, open_page):
    admin = with_liar.person("Bo", "admin")
    assert admin.http.post("/api/v1/zones/imports", params={"source": "t"}, content=ZONES.read_bytes()).is_success
    admin.post("/people", {"name": "Grace", "roles": ["viewer"]})
    page = open_page(with_liar.link(), room="settings")

    def choose(label, value):
        page.locator(".filters").get_by_label(label).select_option(value)

    # The list, what is chosen there, the link that leads in, and the heading of what is seen there.
    for place, chosen, link, inside in (
        ("sessions", None, "Refuted", "Refuted"),
        ("verdicts", ("Outcome", "refuted"), "Refuted", "Refuted"),
        ("people", None, "Grace", "Grace"),
        ("zones/list", None, "Castle", "Castle"),
        ("registry/drones", None, "OH-DRN-0417", "OH-DRN-0417"),
        ("statistics", ("Span of time", "week"), None, "Settings"),
    ):
        page.evaluate("(hash) => { location.hash = hash; }", f"#/{place}")
        expect(page.get_by_role("heading", level=1)).to_be_visible()
        if chosen:
            choose(*chosen)
            page.wait_for_url(f"**={chosen[1]}")
        before = page.url
        if link is None:
            page.keyboard.press(",")
        else:
            page.get_by_role("main").get_by_role("link", name=link).first.click()
        expect(page.get_by_role("heading", name=inside).first).to_be_visible()
        assert page.url != before, place
        page.go_back()
        page.wait_for_url(before)
        if link:
            expect(page.get_by_role("main").get_by_role("link", name=link).first).to_be_visible()
        if chosen:
            expect(page.locator(".filters").get_by_label(chosen[0])).to_have_value(chosen[1])
        page.go_forward()
        expect(page.get_by_role("heading", name=inside).first).to_be_visible()


def test_block_by_block_and_all_the_way_back(with_liar, open_page):
    page = open_page(with_liar.link(), room="ledger")
    visited = []
    for step in (
        page.get_by_role("table").get_by_role("link").first.click,
        page.get_by_role("link", name="Block before").click,
        page.get_by_role("table").get_by_role("link").first.click,
    ):
        expect(page.get_by_role("table").first).to_be_visible()
        visited.append(page.url)
        step()
        page.wait_for_url(lambda url: url != visited[-1])
    for before in reversed(visited):
        page.go_back()
        page.wait_for_url(before)
        expect(page.get_by_role("table").first).to_be_visible()
