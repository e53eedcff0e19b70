"""An officer's tasks in Chromium on a real backend and a real ledger, with the clicks that each takes.

A drone whose ranges put it elsewhere than it claims is proved on the ledger; she finds it, has it explained, suspends
it by her own signature, and takes the evidence with her. Replaying yesterday is in tests/console/test_replay_room.py.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from kit.houses import LIAR
from kit.officer import Officer, seen
from playwright.sync_api import expect


@pytest.mark.timeout(300)
def test_from_the_liar_to_its_suspension_and_the_evidence(with_liar, open_page, tmp_path):
    page = open_page(with_liar.link(), width=1440, height=900)
    expect(page.get_by_role("link", name="Registry")).to_be_visible()
    page.evaluate("location.hash = '#/registry/key'")  # Her key is a matter of her first day, not of this task.
    page.get_by_role("button", name="Use the demo’s administrator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    page.evaluate("location.hash = '#/live'")
    officer = Officer(page)

    liar = page.get_by_role("option").first
    expect(liar).to_contain_text(LIAR)
    expect(liar).to_contain_text("4.2 m off")
    officer.did("find the liar", at_most=0)

    officer.click(liar)
    seen(page.get_by_role("heading", name="Refuted"))
    seen(page.get_by_text(re.compile(r"anchors measured it 4\.2\sm from there")))
    seen(page.get_by_text(re.compile(r"Measured 4\.\d+\sm from the claim, outside 1\.00\sm")).first)
    officer.did("explain why, in words", at_most=1)
    officer.click(page.get_by_role("link", name="Explain"))
    seen(page.get_by_role("heading", name="How it was decided"))
    officer.did("explain why, with ranges, likelihood and signatures", at_most=1)
    page.go_back()

    with page.expect_download() as download:
        officer.click(page.get_by_role("button", name="Evidence", exact=True))
    path = tmp_path / "evidence.json"
    download.value.save_as(path)
    officer.did("export the evidence", at_most=1)
    check(path, with_liar.directory / "ledger" / "connection.json", tmp_path)

    officer.click(page.get_by_role("link", name="Suspend…"))
    expect(page.get_by_label("Reason")).to_have_value(re.compile("^Refuted at pad-0: session [0-9a-f]{12}$"))
    expect(page.get_by_role("button", name="Check and sign")).to_be_focused()
    officer.press("Enter")
    expect(page.get_by_role("button", name="Sign and send")).to_be_focused()
    officer.press("Enter")
    seen(page.get_by_text("It is on the ledger, signed by you."))
    expect(page.locator(".registry-head .status")).to_have_text("Suspended")
    officer.did("suspend the drone", at_most=3)


def check(evidence, connection, directory):
    """The file by itself, with what is pinned from the ledger: every step holds, to the decision made again."""
    wonderland = str(Path(sys.executable).with_name("wonderland"))
    pins = directory / "trust.json"
    for command in (["trust", "--connection", connection, "--out", pins], ["verify", evidence, "--trust", pins]):
        done = subprocess.run(
            [wonderland, "evidence", *map(str, command)], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
