"""WCAG 2.2 AA by axe on every room, both themes and three sizes, on a real backend; no room is wider than its window."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import expect

AXE = Path(__file__).resolve().parents[2] / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
RUN = """async (tags) => {
    const found = await axe.run(document, { runOnly: tags, resultTypes: ["violations"] });
    return found.violations.map((each) => `${each.id}: ${each.help}: ${each.nodes.map((node) => node.target).join(" | ")}`);
}"""
ROOMS = (
    "live", "live?drone=uav-2", "sessions", "verdicts", "alerts", "replay", "registry", "ledger", "people", "people/me",
    "people/audit", "people/clients", "registry/drones", "registry/certificates", "statistics", "settings",
)  # fmt: skip


@pytest.fixture(scope="module")
def axe():
    """The checker's own text."""
    if not AXE.is_file():
        pytest.skip("the console's packages are not installed (make setup)")
    return AXE.read_text("utf-8")


def violations(page, axe):
    page.evaluate(axe)
    return page.evaluate(RUN, TAGS)


def at_rest(page):
    """The room is there, and nothing is being fetched for it."""
    expect(page.locator("main.room")).to_be_visible()
    page.wait_for_load_state("networkidle")
    # A room that is not yet loaded has no heading; the live map's is the list's.
    expect(page.locator("main.room :is(h1, h2)").first).to_be_visible()
    page.evaluate("document.fonts.ready")


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("width", "height", "theme"), [(1280, 800, "light"), (1280, 800, "dark"), (390, 844, "light"), (2560, 1440, "dark")]
)
def test_every_room_is_free_of_barriers_and_fits(real, open_page, axe, width, height, theme):
    page = open_page(real.link("A. Admin", "admin"), width=width, height=height, theme=theme, room="settings")
    expect(page.locator("main.room")).to_be_visible()
    found, wider = {}, []
    for room in ROOMS:
        page.evaluate("(hash) => { location.hash = hash; }", f"#/{room}")
        at_rest(page)
        if barriers := violations(page, axe):
            found[room] = barriers
        if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
            wider.append(room)
    assert not found, "\n".join(f"{room}: {each}" for room, barriers in found.items() for each in barriers)
    assert wider == []


def test_whoever_is_not_signed_in_meets_no_barrier(real, open_page, axe):
    page = open_page(real.url)
    page.watched.expected = ("401", "403")  # so it learns that nobody is signed in
    expect(page.get_by_role("main")).to_be_visible()
    assert violations(page, axe) == []
