"""The registry's forms in Chromium on a real backend and ledger: from a new drone and a new pad to their end."""

from __future__ import annotations

import json
import re

import pytest
from kit.contract import Scene
from kit.registry_house import commissioning
from playwright.sync_api import expect

DONE = "It is on the ledger, signed by you."


def place(page, path):
    page.evaluate("path => { location.hash = `#/registry/${path}` }", path)


def key(page, role):
    place(page, "key")
    page.get_by_role("button", name=f"Use the demo’s {role} key").click()
    expect(page.get_by_text(f"demo-{role.replace(' ', '-').replace('administrator', 'admin')}-").first).to_be_visible()


def fill(page, **fields):
    for label, text in fields.items():
        page.get_by_label(label.replace("_", " ")).fill(text)


def sign(page):
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    expect(page.get_by_text(DONE)).to_be_visible()


def choose(page, file):
    """As a person does, by the browser's own dialog: for a file that was chosen before it tells of no change."""
    with page.expect_file_chooser() as asked:
        page.locator("input[type=file]").click()
    asked.value.set_files(file)


def status(page):
    return page.locator(".registry-head .status")


@pytest.fixture
def page(console_house, open_page):
    return open_page(console_house.link(), room="registry")


def approve(house, page):
    """As the second person, who is somewhere else."""
    asked = page.evaluate("fetch('/api/v1/registry/proposals?state=open').then((answer) => answer.json())")
    (proposal,) = asked["items"]
    house.send("inspector", "ApproveChange", Scene.approval(proposal["record"]))
    page.wait_for_function(
        "fetch('/api/v1/registry/proposals?state=open').then(async (answer) => (await answer.json()).items.length === 0)"
    )


def test_a_drone_from_its_registration_to_its_end(console_house, page):
    key(page, "fleet operator")
    place(page, "drones/new")
    fill(page, Serial_number="OH-DRN-0999", Model="Räven 2", Operator="arctic-air", Registration_number="FIN87abc")
    sign(page)
    place(page, "drones/OH-DRN-0999")
    expect(status(page)).to_have_text("Active")
    key(page, "administrator")
    for form, after in (("suspend", "Suspended"), ("reactivate", "Suspended"), ("retire-drone", "Retired")):
        place(page, f"drones/OH-DRN-0999/{form}")
        fill(page, Reason=f"{form}, by a test")
        sign(page)
        expect(status(page)).to_have_text(after)
        if form == "reactivate":
            approve(console_house, page)
            expect(status(page)).to_have_text("Active")  # on the page that is open, without a reload
            place(page, "drones/OH-DRN-0640")
            place(page, "drones/OH-DRN-0999")
            expect(status(page)).to_have_text("Active")
    expect(page.get_by_role("navigation", name="What can be done").get_by_role("link")).to_have_count(0)
    expect(page.locator(".history li")).to_have_count(4)


def test_a_pad_from_its_registration_over_commissioning_to_its_end(console_house, page, tmp_path):
    key(page, "pad operator")
    place(page, "pads/new")
    fill(page, Name="Ruissalo", Operator="turku-city", Height="21,5")
    fill(page, Pad="ruissalo-1", Latitude="60,4337", Longitude="22.1702")
    sign(page)
    place(page, "pads/ruissalo-1")
    expect(status(page)).to_have_text("Registered")
    expect(page.get_by_text("has not been surveyed yet")).to_be_visible()

    place(page, "pads/ruissalo-1/commission")
    file = tmp_path / "commissioning.json"
    file.write_text("{ no JSON")
    choose(page, file)
    page.get_by_role("button", name="Check and sign").click()
    expect(page.get_by_text("No commissioning could be read from the file.")).to_be_visible()
    # The same file, mended.
    file.write_text(json.dumps(commissioning(console_house.now_ms(), 60.4337, 22.1702).to_json()))
    choose(page, file)
    expect(page.locator(".field-error")).to_have_count(0)
    sign(page)
    expect(status(page)).to_have_text("Commissioned")
    expect(page.get_by_role("definition").filter(has_text="Tachymeter survey").first).to_be_visible()

    place(page, "pads/ruissalo-1/retire-pad")
    fill(page, Reason="The quay is rebuilt")
    sign(page)
    expect(status(page)).to_have_text("Retired")


def test_the_registration_is_masked_until_a_reason_is_given(console_house, page):
    place(page, "drones/OH-DRN-0417")
    masked = page.locator(".masked")
    expect(masked).to_contain_text("•••")
    whole = "FIN87astrdge12k8"
    assert whole not in page.content()
    masked.get_by_role("button", name="Show").click()
    masked.get_by_label("Why do you need to see it?").fill("Collision at Aurajoki, case <b>7</b>")
    masked.get_by_role("button", name="Show").click()
    expect(masked).to_contain_text(whole)
    page.evaluate("location.hash = '#/people/audit'")
    row = page.get_by_role("row").filter(has_text="looked at a masked number")
    expect(row).to_contain_text("Anna Officer")
    expect(row).to_contain_text("Collision at Aurajoki, case <b>7</b>")


def test_two_officers_sign_at_the_same_moment(console_house, page):
    """The other's change is ordered while hers is on its way: the peers find it invalid, and she reads why."""
    key(page, "administrator")
    place(page, "drones/OH-DRN-0417/suspend")
    fill(page, Reason="Mine")

    def quicker(route):
        told = {"uav_id": "OH-DRN-0417", "status": "suspended", "reason": "The other was quicker"}
        console_house.send("admin", "SetUavStatus", told)
        route.continue_()

    page.route("**/submit", quicker)
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    failure = page.get_by_role("alert")
    expect(failure).to_contain_text("Changed meanwhile")
    expect(failure).to_contain_text("Nothing was overwritten")
    expect(failure).to_contain_text(re.compile(r"MVCC_READ_CONFLICT in block \d+"))
    expect(failure.get_by_role("row").filter(has_text="Reason")).to_contain_text("The other was quicker")
    page.unroute("**/submit")
    failure.get_by_role("button", name="Go on with my entries").click()
    expect(page.get_by_label("Reason")).to_have_value("Mine")
    sign(page)


def test_what_the_contract_refuses_is_said_in_its_own_words(console_house, page):
    """The drone was retired while the form was open; the contract's reason is shown, not a number."""
    key(page, "administrator")
    place(page, "drones/OH-DRN-0640/grant")
    fill(page, Identifier="too-late")
    told = {"uav_id": "OH-DRN-0640", "status": "retired", "reason": "Scrapped"}
    console_house.send("admin", "SetUavStatus", told)
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    failure = page.get_by_role("alert")
    expect(failure).to_contain_text("The contract refuses it")
    expect(failure).to_contain_text("drone OH-DRN-0640 is retired for good")
    expect(failure).to_contain_text("UAV_RETIRED")
    page.get_by_role("button", name="Back").click()
    expect(page.get_by_label("Identifier")).to_have_value("too-late")


def test_a_list_that_is_too_large_is_refused_before_it_is_sent(page):
    place(page, "import")
    line = b"OH-DRN-1000;Falcon;arctic-air;\r\n"
    buffer = b"uav_id;model;operator_id;registration\r\n" + line * (1 + (1 << 20) // len(line))
    page.get_by_label("CSV file").set_input_files({"name": "all.csv", "mimeType": "text/csv", "buffer": buffer})
    expect(page.get_by_role("alert")).to_have_text("The file is larger than 1 MiB. Split it.")
    expect(page.get_by_role("button", name="Check the file")).to_be_disabled()
    # Whoever goes around the page is refused, too.
    send = """async (text) => {
        const options = { method: "POST", headers: { "Content-Type": "text/csv" }, body: text };
        const answer = await fetch("/api/v1/registry/imports/drones", options);
        return [answer.status, (await answer.json()).detail];
    }"""
    page.watched.expected = ("413",)
    status, detail = page.evaluate(send, buffer.decode())
    assert status == 413
    assert "1048576" in detail
