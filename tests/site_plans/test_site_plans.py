"""A plan by REST and in Chromium: brought, checked, looked at, signed, drawn; who may, and what nobody may."""

from __future__ import annotations

import hashlib
import json

from kit import barriers
from playwright.sync_api import expect

from wonderland_backend.site_plans import store
from wonderland_simulator.place.plans import site_plan

PAD = "aurajoki-2"
PLAN = site_plan("hatter-quay")
HOSTILE = '<img src=x onerror="document.title=1">'


def bring(somebody, body, pad_id=PAD):
    return somebody.http.post(f"/api/v1/site-plans/{pad_id}", content=body)


def test_a_plan_is_kept_and_given_back_byte_for_byte(house):
    paula = house.person("Paula", "pad_operator", msp_id="PadMSP")
    first = bring(paula, PLAN)
    assert first.status_code == 201, first.text
    sha256 = hashlib.sha256(PLAN).hexdigest()
    assert first.json() == {"pad_id": PAD, "sha256": sha256, "size_bytes": len(PLAN), "features": 13, "image": False}
    assert bring(paula, PLAN).status_code == 200, "the same file again"
    found = paula.get(f"/site-plans/{PAD}/{sha256}")
    assert (found.content, found.headers["content-type"]) == (PLAN, "application/geo+json")
    assert "immutable" in found.headers["cache-control"]
    assert found.headers["x-content-type-options"] == "nosniff"
    assert "sandbox" in found.headers["content-security-policy"]


def test_what_is_wrong_is_told_with_each_place(house):
    paula = house.person("Paula", "pad_operator", msp_id="PadMSP")
    answer = bring(paula, PLAN.replace(b'"tlof"', b'"castle"', 1))
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["path"] == "features[3].properties.kind"
    assert bring(paula, b"x" * (4 << 20)).status_code == 413
    assert bring(paula, b"").json()["errors"][0]["path"] == "file"


def test_who_may_bring_and_see_which_plan(house):
    sha256 = bring(house.person("Paula", "pad_operator", msp_id="PadMSP"), PLAN).json()["sha256"]
    assert bring(house.person("Finn", "fleet_operator", msp_id="FleetMSP"), PLAN).status_code == 403
    rival = house.person("Rita", "pad_operator", msp_id="OtherPadMSP")
    assert (bring(rival, PLAN).status_code, rival.get(f"/site-plans/{PAD}/{sha256}").status_code) == (404, 404)
    assert bring(house.person("Anna", "admin"), PLAN, "no-such-pad").status_code == 404
    with_nobody = house.person("Otto", "admin")
    with_nobody.http.cookies.clear()
    assert with_nobody.get(f"/site-plans/{PAD}/{sha256}").status_code == 401
    assert bring(with_nobody, PLAN).status_code in {401, 403}
    assert house.person("Olga", "admin").get(f"/site-plans/{PAD}/{'0' * 64}").status_code == 404


def test_a_pad_keeps_so_many_plans_and_no_more(house, monkeypatch):
    monkeypatch.setattr(store, "MOST_PLANS", 2)
    paula = house.person("Paula", "pad_operator", msp_id="PadMSP")
    assert [bring(paula, PLAN + b" " * extra).status_code for extra in range(3)] == [201, 201, 409]
    assert bring(paula, PLAN).status_code == 200, "what is there stays"


def test_brought_looked_at_signed_and_drawn(console_house, open_page, tmp_path):
    page = open_page(console_house.link(), room="registry/key")
    page.get_by_role("button", name="Use the demo’s pad operator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    page.evaluate(f"location.hash = '#/registry/pads/{PAD}/site-plan'")
    expect(page.get_by_text("No plan of this site is on the ledger.")).to_be_visible()
    file = tmp_path / "plan.geojson"
    document = json.loads(PLAN)
    document["features"][-1]["properties"]["name"] = HOSTILE
    crossed = json.loads(PLAN)
    crossed["features"][0]["geometry"]["coordinates"] = [[[0, 0], [5, 5], [5, 0], [0, 5], [0, 0]]]

    def choose(content):
        file.write_text(json.dumps(content))
        with page.expect_file_chooser() as asked:
            page.locator("input[type=file]").click()
        asked.value.set_files(file)

    page.watched.expected = ("422",)
    choose(crossed)
    expect(page.get_by_role("alert")).to_contain_text("the ring crosses itself")
    assert page.get_by_role("button", name="Check and sign").count() == 0, "there is nothing to sign"
    choose(document)
    drawing = page.get_by_role("img", name="Plan of the site from above: 13 things")
    expect(drawing).to_be_visible()
    expect(drawing).to_contain_text(HOSTILE)
    assert barriers.on(page) == []
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    expect(page.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    page.evaluate(f"location.hash = '#/registry/pads/{PAD}'")
    expect(drawing).to_be_visible()
    expect(page.locator(".plan-legend")).to_contain_text("Safety area")
    assert barriers.anywhere(page) == []
    assert page.title() != "1", "a name was taken for markup"
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    expect(page.locator(".history")).to_contain_text("Site plan, SHA-256")
    page.evaluate(
        "sha => fetch(`/api/v1/registry/pads/aurajoki-2`).then(r => r.json()).then(d => { window.sha = d.pad.record.site_plan_sha256 })",
        sha256,
    )
    page.wait_for_function("sha => window.sha === sha", arg=sha256)


def test_another_file_than_the_ledger_names_is_not_drawn(console_house, open_page):
    page = open_page(console_house.link(), room="registry/key")
    page.get_by_role("button", name="Use the demo’s pad operator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    page.route(
        "**/api/v1/site-plans/*/*", lambda route: route.fulfill(body=PLAN + b" ", content_type="application/geo+json")
    )
    page.evaluate(
        """body => fetch('/api/v1/site-plans/aurajoki-2', { method: 'POST', body, headers: { 'Content-Type': 'application/geo+json' } })""",
        PLAN.decode(),
    )
    page.evaluate(f"location.hash = '#/registry/pads/{PAD}/site-plan'")
    page.locator("input[type=file]").set_input_files({"name": "p.json", "mimeType": "application/json", "buffer": PLAN})
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    expect(page.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    page.evaluate(f"location.hash = '#/registry/pads/{PAD}'")
    expect(page.get_by_role("alert").filter(has_text="not the one whose hash is on the ledger")).to_be_visible()
    assert page.locator("svg.site-plan").count() == 0
