"""What axe finds on a page of the console: barriers against WCAG 2.2 AA."""

from __future__ import annotations

from pathlib import Path

import pytest

AXE = Path(__file__).resolve().parents[2] / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
FIND = """async () => {
    const tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];
    const found = await axe.run("main.room", { runOnly: tags, resultTypes: ["violations"] });
    return found.violations.map((each) => `${each.id}: ${each.nodes.map((node) => node.target).join(" | ")}`);
}"""


def axe():
    """The program, to be evaluated in the page before ``FIND``; skips a test where it is not installed."""
    if not AXE.is_file():
        pytest.skip("axe-core is not installed (make setup)")
    return AXE.read_text("utf-8")


def on(page):
    """What bars somebody on this page's room."""
    page.evaluate(axe())
    return page.evaluate(FIND)
