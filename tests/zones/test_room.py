"""Zones in Chromium on a real backend and ledger: a broken file, a good one, the map, closures, a landing refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from kit import barriers
from kit.houses import Place
from kit.scenario_world import Site, people_at
from playwright.sync_api import expect

FILES = Path(__file__).parent / "files"


def go(page, path):
    page.evaluate("path => { location.hash = `#/${path}` }", path)


@pytest.fixture
def officer(console_house, open_page):
    """A page of somebody who has the demo's administrator key."""
    page = open_page(console_house.link(), room="zones")
    expect(page.get_by_role("heading", name="Zones")).to_be_visible()
    go(page, "registry/key")
    page.get_by_role("button", name="Use the demo’s administrator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    return page


def choose(page, name):
    page.locator("input[type=file]").set_input_files(FILES / name)
    page.get_by_role("button", name="Check").click()


def test_from_a_broken_file_to_a_landing_that_is_refused(console_house, officer):
    house, page = console_house, officer
    go(page, "zones/import")
    page.get_by_label("Source").fill("turku")
    choose(page, "broken.ed318.json")
    expect(page.get_by_role("alert")).to_contain_text("16 errors")
    row = page.get_by_role("row").filter(has_text="features[1].geometry.coordinates[0][3]")
    expect(row).to_contain_text("the ring is not closed")
    expect(row.get_by_role("cell").first).to_have_text("32")
    expect(page.get_by_role("button", name="Import", exact=True)).to_have_count(0)

    choose(page, "turku.ed318.json")
    expect(page.get_by_role("status")).to_contain_text("ED-318: 3 zones, no errors.")
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.get_by_text("Now see what it means for the pads")).to_be_visible()
    expect(page.get_by_role("row").filter(has_text="turku")).to_contain_text("in force")

    # On the map, and what holds where one clicks.
    go(page, "live?at=60.4522,22.2635,16")
    expect(page.locator(".zones-legend")).to_contain_text("Prohibited")
    box = page.locator("canvas.maplibregl-canvas").bounding_box()
    page.mouse.click(box["x"] + (box["width"] + 340) / 2, box["y"] + (box["height"] - 150) / 2)
    card = page.locator(".zone-card")
    expect(card).to_contain_text("Castle")
    expect(card).to_contain_text("No flights over the castle")
    expect(card).to_contain_text("0 m AGL to 120 m AGL")
    assert "zone=FIN%3AP20" in page.evaluate("location.hash")
    page.get_by_role("button", name="Hide zones").click()
    expect(card).to_have_count(0)

    async def site():
        async with people_at(Place(house)) as people:
            return await Site(people, "shut", "PadMSP").ready()

    pad_id = house.run(site(), 60).pad_id
    house.wait_mirrored()

    go(page, "zones")
    row = page.get_by_role("row").filter(has_text=pad_id)
    expect(row).to_contain_text("Not published")
    row.get_by_role("link").click()
    assert barriers.on(page) == []
    page.get_by_role("button", name="Publish closures").click()
    page.get_by_role("button", name="Sign and send").click()
    expect(page.locator(".zone-state")).to_contain_text("Published")

    async def landing():
        async with people_at(Place(house)) as people:
            its = Site(people, "shut", "PadMSP")
            its.pad, its.uav = people[its.pad_id], people[its.uav_id]
            session = await its.request("k0")
            return session["session_id"], await its.judge(session)

    session_id, verdict = house.run(landing(), 60)
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "refused")
    assert [each["code"] for each in verdict["reasons"]].count("zone_active") == 1
    house.wait_mirrored()
    go(page, f"sessions/{session_id}")
    expect(page.get_by_text(f"Zone FIN:P20 forbids landing at pad {pad_id}.").first).to_be_visible()
    go(page, "alerts")
    expect(page.get_by_text("which the zone FIN:P20 closes").first).to_be_visible()


def test_a_zone_in_finnish(console_house, officer):
    house, page = console_house, officer
    admin = house.person("Aino", "admin")
    admin.http.post(
        "/api/v1/zones/imports", params={"source": "turku"}, content=(FILES / "turku.ed318.json").read_bytes()
    )
    go(page, "zones/list")
    expect(page.get_by_role("row").filter(has_text="FIN:P20")).to_contain_text("in force")
    page.get_by_role("button", name="Language: English").click()
    page.get_by_role("row").filter(has_text="NIGHT 1").get_by_role("link").click()
    expect(page.locator(".zone-facts")).to_contain_text("Joka päivä: auringonlasku – auringonnousu")


def test_a_landing_that_the_policy_refuses_says_so(console_house, open_page):
    """The place is right, and nobody has authorised the drone: verified, refused, and the reason in words."""
    house = console_house

    async def landing():
        async with people_at(Place(house)) as people:
            its = await Site(people, "bare", "PadMSP").ready(authorised=False)
            session = await its.request("k0")
            return session["session_id"], await its.judge(session)

    session_id, verdict = house.run(landing(), 60)
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "refused")
    house.wait_mirrored()
    page = open_page(house.link(), room=f"sessions/{session_id}")
    expect(page.get_by_text("authoris").first).to_be_visible()
    go(page, "alerts")
    expect(page.get_by_text("without being authorised").first).to_be_visible()
