"""What axe finds on a page of the console: barriers against WCAG 2.2 AA."""

from __future__ import annotations

from pathlib import Path

import pytest

AXE = Path(__file__).resolve().parents[2] / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
CONTRAST = ["color-contrast"]
SIZES = ((390, 844), (1280, 800), (2560, 1440))
FIND = """async (only) => {
    const found = await axe.run(document, { runOnly: only, resultTypes: ["violations"] });
    return found.violations.map((each) => `${each.id}: ${each.help}: ${each.nodes.map((node) => node.target).join(" | ")}`);
}"""
DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
WIDER = """() => [document.documentElement, ...document.querySelectorAll("main, .page")]
    .some((each) => each.scrollWidth > each.clientWidth)"""


def axe():
    """The program, to be evaluated in the page before ``FIND``; skips a test where it is not installed."""
    if not AXE.is_file():
        pytest.skip("axe-core is not installed (make setup)")
    return AXE.read_text("utf-8")


def looks(page):
    """The page at every width and in both themes: what to call it, and which rules there are to hold.

    A theme changes colours and nothing else, so that its contrasts are all that has to be looked at again.
    """
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for theme, only in (("light", TAGS), ("dark", CONTRAST)):
            page.emulate_media(color_scheme=theme)
            page.evaluate(DRAWN)
            yield f"{width} px, {theme}", only


def on(page, only=TAGS):
    """What bars somebody on this page as it is, and whether it is wider than its window."""
    if page.evaluate("typeof axe === 'undefined'"):
        page.evaluate(axe())
    return [*page.evaluate(FIND, only), *(["wider than its window"] if page.evaluate(WIDER) else [])]


def anywhere(page):
    """The same for every look of it."""
    return [f"{look}: {each}" for look, only in looks(page) for each in on(page, only)]
