"""Nothing left out: the demo as `make demo` starts it, seen through Chromium."""

from __future__ import annotations

import re
import signal
import subprocess
import sys

import pytest
from playwright.sync_api import expect

VERDICT_MS = 90_000


@pytest.fixture
def demo(browser, built_console):
    """(link, nothing else needed): the demo runs as long as the test does."""
    del browser, built_console
    process = subprocess.Popen(
        [sys.executable, "-m", "wonderland.cli", "demo"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        link = next(
            match.group()
            for line in process.stdout
            if (match := re.search(r"http://127\.0\.0\.1:\d+/#token=\S+", line))
        )
        yield link
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)
        assert process.returncode == 0


@pytest.mark.browser
@pytest.mark.timeout(180)
def test_the_officer_sees_who_lies(demo, open_page):
    page = open_page(demo)
    expect(page.get_by_text("Embedded ledger, no multi-party trust")).to_be_visible()
    rows = page.get_by_role("option")
    liar = rows.filter(has_text="OH-DRN-0417")
    expect(liar).to_contain_text("Refuted at Hatter Quay", timeout=VERDICT_MS)
    expect(rows.filter(has_text="OH-DRN-0640")).to_contain_text("Impersonation or lie", timeout=VERDICT_MS)
    expect(rows.filter(has_text="OH-DRN-0233")).to_contain_text("Verified at Hatter Quay", timeout=VERDICT_MS)
    liar.click()
    expect(page.get_by_role("heading", name="Refuted")).to_be_visible()
    expect(page.get_by_text(re.compile(r"Four anchors measured it"))).to_be_visible()
    for step in ("1 Request on the ledger", "2 Pad polls", "6 Drone countersigns"):
        expect(page.get_by_text(step, exact=True)).to_be_visible()
