"""One session's page, on a real backend: what shows a lie, who said what to whom, and what one can do about it."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect


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
        assert claimed > 1 > 0.1 > estimated
    card.get_by_text("The same as a table").click()
    expect(card.get_by_role("row")).to_have_count(5)
