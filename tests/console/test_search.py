"""The search box in Chromium on a real backend."""

from __future__ import annotations

import pytest
from kit.facts import FRAME
from playwright.sync_api import expect
from sqlalchemy import insert

from wonderland_backend.db.tables.reported import LatestTrackRow, TrackMinuteRow, TrackRow


@pytest.fixture
def page(real, open_page):
    opened = open_page(real.link())
    expect(opened.get_by_role("option")).to_have_count(2)
    return opened


def test_a_drone_by_its_registration_with_the_keyboard_alone(page):
    page.keyboard.press("/")
    box = page.get_by_role("combobox", name="Search")
    expect(box).to_be_focused()
    box.press_sequentially("fin87astrdge12k8")
    hits = page.get_by_role("search").get_by_role("option")
    expect(hits).to_have_count(2)
    page.keyboard.press("ArrowDown")
    expect(hits.nth(1)).to_have_attribute("aria-selected", "true")
    page.keyboard.press("Enter")
    expect(page.get_by_role("region", name="Proof")).to_be_visible()
    assert "drone=uav-2" in page.url


def test_a_transaction_by_its_first_digits(page):
    tx_id = page.evaluate("fetch('/api/v1/verdicts').then((r) => r.json()).then((r) => r.items[0].tx_id)")
    page.get_by_role("combobox", name="Search").fill(tx_id[:10])
    page.get_by_role("search").get_by_role("option").filter(has_text="SubmitProof").click()
    expect(page.get_by_text("Valid: its writes count.")).to_be_visible()


def test_what_does_not_exist_is_said_as_text(page):
    box = page.get_by_role("combobox", name="Search")
    box.fill("<img src=x onerror=alert(1)>")
    expect(page.get_by_role("search").get_by_role("status")).to_contain_text("Nothing fits “<img")
    box.press("Escape")
    expect(box).to_have_value("")


async def heard(database, uav_id, t_ms, place):
    """A position as the ingest keeps it."""
    body = (
        f'{{"uav_id":"{uav_id}","lat_e7":{place["lat_e7"] + 900},"lon_e7":{place["lon_e7"]},"t_ms":{t_ms},'
        '"pad_id":"pad-1","transport":"wifi","verified":false}'
    )
    row = {"uav_id": uav_id, "pad_id": "pad-1", "t_ms": t_ms, "body": body}
    async with database.write() as connection:
        await connection.execute(insert(TrackRow), [row | {"received_ms": t_ms}])
        await connection.execute(insert(LatestTrackRow), [row])
        await connection.execute(insert(TrackMinuteRow), [{"minute_ms": t_ms - t_ms % 60_000, "positions": 1}])


@pytest.mark.parametrize("minutes_ago", [0, 90])
def test_what_only_broadcasts_is_found_where_it_is_or_was(real, page, minutes_ago):
    place = FRAME
    ghost = "1581F5FKGHOST"
    real._run(heard(real.backend.database, ghost, real.now_ms() - minutes_ago * 60_000, place))
    if minutes_ago == 0:
        real.hear(ghost, place["lat_e7"] + 900, place["lon_e7"])
        expect(page.get_by_role("option").filter(has_text=ghost)).to_be_visible()
    page.get_by_role("combobox", name="Search").fill("ghost")
    hit = page.get_by_role("search").get_by_role("option").filter(has_text=ghost)
    expect(hit).to_contain_text("Not registered")
    hit.click()
    if minutes_ago == 0:
        page.wait_for_url(f"**/#/live?drone={ghost}**")
        expect(page.get_by_role("region", name="Proof")).to_contain_text(ghost)
    else:
        page.wait_for_url(f"**/#/replay?*drone={ghost}**")
        expect(page.get_by_role("region", name="Replay")).to_contain_text(ghost)


def test_a_pad_is_found_on_the_map(real, page):
    page.get_by_role("combobox", name="Search").fill("aurajoki")
    page.get_by_role("search").get_by_role("option").filter(has_text="Aurajoki 2").click()
    place = FRAME
    page.wait_for_url(f"**/#/live?list=pads&at={place['lat_e7'] / 1e7:.7f},**")
    expect(page.get_by_role("list", name="Pads").get_by_text("Aurajoki 2")).to_be_visible()
