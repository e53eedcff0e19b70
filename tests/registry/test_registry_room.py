"""The registry in Chromium on a real backend and ledger: enrol, change, conflict, refusal, import, drafts."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from kit.contract import Scene
from playwright.sync_api import expect

DRONE = "OH-DRN-0417"


@pytest.fixture
def officer(console_house, open_page):
    """A page of somebody who has the demo's administrator key."""
    page = open_page(console_house.link(), room="registry")
    expect(page.get_by_role("link", name="Registry")).to_be_visible()
    place(page, "key")
    page.get_by_role("button", name="Use the demo’s administrator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    return page


def place(page, path):
    page.evaluate("path => { location.hash = `#/registry/${path}` }", path)


def sign(page):
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()


def test_suspending_takes_two_clicks_and_stays_in_the_history(console_house, officer):
    place(officer, f"drones/{DRONE}/suspend")
    officer.get_by_label("Reason").fill("Refuted twice. <b>Not</b> markup.")
    sign(officer)
    expect(officer.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    expect(officer.get_by_text("Endorsed by AuthorityMSP, PadMSP")).to_be_visible()
    expect(officer.locator(".registry-head .status")).to_have_text("Suspended")
    history = officer.locator(".history li").first
    expect(history).to_contain_text("SetUavStatus")
    expect(history).to_contain_text("demo-admin-")
    expect(history.locator("ins").filter(has_text="Refuted twice. <b>Not</b> markup.")).to_be_visible()
    officer.get_by_role("link", name="Transaction", exact=True).first.click()
    expect(officer.get_by_role("heading", level=1)).to_contain_text("SetUavStatus")
    officer.go_back()
    expect(officer.get_by_role("heading", name=DRONE, exact=True)).to_be_visible()


def test_the_key_cannot_be_read_and_the_server_never_has_it(console_house, officer):
    told = officer.evaluate(
        """async () => {
            const database = await new Promise((done) => {
                const asked = indexedDB.open("wonderland-signing");
                asked.onsuccess = () => done(asked.result);
            });
            const all = await new Promise((done) => {
                const asked = database.transaction("keys").objectStore("keys").getAll();
                asked.onsuccess = () => done(asked.result);
            });
            database.close();
            const [{ key }] = all;
            const formats = [];
            for (const format of ["pkcs8", "jwk", "raw"])
                await crypto.subtle.exportKey(format, key).then(() => formats.push(format), () => undefined);
            return { count: all.length, extractable: key.extractable, usages: key.usages, formats };
        }"""
    )
    assert told == {"count": 1, "extractable": False, "usages": ["sign"], "formats": []}
    for file in Path(console_house.directory).glob("registry.db*"):
        assert b"PRIVATE KEY" not in file.read_bytes()


def test_enrolling_with_a_one_time_secret(console_house, open_page):
    invited = console_house.administration.invite("frida", role="fleet_operator", pol_id="frida")
    page = open_page(console_house.link("Frida", ("fleet_operator",)), room="registry")
    expect(page.get_by_role("link", name="Registry")).to_be_visible()
    place(page, "key")
    form = page.locator("section").filter(has_text="Enrol with a one-time secret")
    form.get_by_label("Organisation").select_option("FleetMSP")
    form.get_by_label("Name").fill("frida")
    form.get_by_label("One-time secret").fill("a guess")
    page.watched.expected = ("403",)
    form.get_by_role("button", name="Make a key and enrol").click()
    expect(form.get_by_role("alert")).to_contain_text("do not fit")
    form.get_by_label("One-time secret").fill(invited.secret)
    form.get_by_role("button", name="Make a key and enrol").click()
    expect(page.get_by_text("in use")).to_be_visible()
    page.reload()
    expect(page.get_by_text("in use")).to_be_visible()


def test_a_role_that_may_not_is_told_before_and_refused_by_the_contract(console_house, officer):
    place(officer, "key")
    officer.get_by_role("button", name="Use the demo’s pad operator key").click()
    expect(officer.locator(".key-row")).to_have_count(2)
    place(officer, f"drones/{DRONE}/suspend")
    officer.get_by_label("Reason").fill("I should not")
    officer.get_by_role("button", name="Check and sign").click()
    expect(officer.get_by_role("note")).to_contain_text("you sign as pad operator")
    officer.get_by_role("button", name="Sign and send").click()
    failure = officer.get_by_role("alert")
    expect(failure).to_contain_text("The contract refuses it")
    expect(failure).to_contain_text("ROLE_NOT_ALLOWED")
    expect(failure).to_contain_text("this certificate's role is pad_operator")
    officer.get_by_role("button", name="Back").click()
    expect(officer.get_by_label("Reason")).to_have_value("I should not")


@pytest.fixture
def calibrated(console_house):
    """A drone that was ranged at a pad and calibrated there, as the contract takes it; the pad's id."""
    scene = Scene()

    def send(*what):
        return json.loads(console_house.send(*what).payload)

    scene.now_ms = console_house.now_ms()
    valid = {"valid_from_ms": scene.now_ms - 60_000, "valid_until_ms": scene.now_ms + 10**10}
    send("pad_operator", "RegisterPad", scene.pad_argument())
    send("pad_operator", "CommissionPad", {"pad_id": "pad-1", "commissioning": scene.commissioning(**valid)})
    prekeys = [{"prekey_id": "k1", "public_key": scene.point(60)}]
    send("pad", "PublishPrekeys", {"pad_id": "pad-1", "prekeys": prekeys})
    send("fleet_operator", "RegisterUav", scene.uav_argument("uav-1"))
    session = send("uav", "RequestProof", scene.request_argument())
    send("pad", "SubmitProof", {"session_id": session["session_id"], "evidence": scene.evidence(session)})
    measured = scene.calibration(session["session_id"], uav_id="uav-1", valid_until_ms=scene.now_ms + 10**9)
    send("pad_operator", "CalibrateUav", measured)
    console_house.wait_mirrored()
    return "pad-1"


def test_a_drones_calibration_is_shown_and_withdrawn(console_house, officer, calibrated):
    place(officer, f"drones/{DRONE}")
    card = officer.locator("section").filter(has=officer.get_by_role("heading", name="Calibration of its node"))
    expect(card).to_contain_text("Nobody has calibrated this drone’s node")
    expect(card).to_contain_text("judged with the prior")
    place(officer, "drones/uav-1")
    row = card.get_by_role("row").filter(has_text=calibrated)
    expect(row).to_contain_text("0.30 m ± 0.02 m")
    expect(row).to_contain_text("in force")
    expect(row).to_contain_text("pad_operator · PadMSP")
    row.get_by_role("link", name="Withdraw the calibration").click()
    officer.get_by_label("Reason").fill("Another antenna")
    sign(officer)
    expect(officer.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    expect(row).to_contain_text("withdrawn")
    history = officer.locator(".history li").first
    expect(history).to_contain_text("pad-1: 0.30 m ± 0.02 m → pad-1: 0.30 m ± 0.02 m (withdrawn: Another antenna)")
    expect(row.get_by_role("link")).to_have_count(0)


def test_two_officers_and_one_record(console_house, officer):
    place(officer, f"drones/{DRONE}/maintenance")
    officer.get_by_label("Work").fill("Motors")
    console_house.send("admin", "SetUavStatus", {"uav_id": DRONE, "status": "suspended", "reason": "by another"})
    sign(officer)
    failure = officer.get_by_role("alert")
    expect(failure).to_contain_text("Somebody else changed the record since you opened it")
    row = failure.get_by_role("row").filter(has_text="Status").first
    expect(row).to_contain_text("Active")
    expect(row).to_contain_text("Suspended")
    officer.get_by_role("button", name="Go on with my entries").click()
    expect(officer.get_by_label("Work")).to_have_value("Motors")
    sign(officer)
    expect(officer.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    expect(officer.locator(".registry-head .status")).to_have_text("Suspended")


def test_a_policy_is_checked_by_the_contracts_bounds(console_house, officer):
    place(officer, "pads/aurajoki-2/policy/land")
    buffer = officer.get_by_label("Buffer around the claim, m")
    expect(buffer).to_have_value("1")
    buffer.fill("0.05")
    officer.get_by_label("Refuted below likelihood, %").fill("99,5")
    officer.get_by_role("button", name="Check and sign").click()
    expect(buffer).to_be_focused()
    expect(officer.get_by_text("At least 0.1.")).to_be_visible()
    expect(officer.get_by_text("must leave room between them")).to_be_visible()
    buffer.fill("2,5")
    officer.get_by_label("Refuted below likelihood, %").fill("1")
    sign(officer)
    expect(officer.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    place(officer, "proposals")
    proposal = officer.locator("section.card").filter(has_text="Policy: aurajoki-2, Landing")
    expect(proposal).to_contain_text("waits for a second person")
    changed = proposal.get_by_role("row").filter(has_text="Buffer around the claim")
    expect(changed).to_contain_text("1.00 m")
    expect(changed).to_contain_text("2.50 m")
    proposal.get_by_role("link", name="Look and approve").click()
    expect(proposal).to_contain_text("Somebody else has to approve it.")
    officer.get_by_role("button", name="Sign and send").click()
    expect(officer.get_by_role("alert")).to_contain_text("SAME_PERSON")
    place(officer, "key")
    officer.get_by_role("button", name="Use the demo’s inspector key").click()
    expect(officer.get_by_text("demo-inspector-").first).to_be_visible()
    place(officer, "proposals")
    proposal.get_by_role("link", name="Look and approve").click()
    officer.get_by_role("button", name="Sign and send").click()
    expect(proposal).to_contain_text("Approved by")
    place(officer, "pads/aurajoki-2")
    landing = (
        officer.locator("section")
        .filter(has_text="What holds for each action")
        .get_by_role("row")
        .filter(has_text="Landing")
    )
    expect(landing).to_contain_text("2.50 m")
    expect(landing).to_contain_text("set here")


def test_granting_and_revoking(console_house, officer):
    place(officer, f"drones/{DRONE}/grant")
    officer.get_by_label("Identifier").fill("summer")
    sign(officer)
    expect(officer.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    authorisations = officer.locator("section").filter(has=officer.get_by_role("heading", name="Authorisations"))
    row = authorisations.get_by_role("row").filter(has_text="summer")
    expect(row).to_contain_text("in force")
    row.get_by_role("link", name="Revoke the authorisation").click()
    officer.get_by_label("Reason").fill("Season over")
    sign(officer)
    expect(row).to_contain_text("revoked")


def test_what_is_typed_survives_a_session_that_ends(console_house, officer):
    place(officer, f"drones/{DRONE}/suspend")
    officer.get_by_label("Reason").fill("Half a sentence")
    officer.watched.expected = ("401",)
    officer.context.clear_cookies()
    officer.reload()
    expect(officer.get_by_label("Reason")).to_have_count(0)
    address = officer.url
    officer.evaluate("url => { location.href = url }", console_house.link())
    officer.reload()
    expect(officer.get_by_role("link", name="Registry")).to_be_visible()
    officer.goto(address)
    expect(officer.get_by_label("Reason")).to_have_value("Half a sentence")
    expect(officer.get_by_text("What you typed before is still here.")).to_be_visible()


def test_bytes_that_are_others_are_not_signed(console_house, officer):
    """A server that gives another proposal to sign than was asked for."""

    def lie(route):
        request = route.request
        body = request.post_data_json
        body["argument"] = {**body["argument"], "uav_id": "OH-DRN-0640"}
        route.continue_(post_data=json.dumps(body))

    endorsed = []
    officer.on("request", lambda request: endorsed.append(request.url) if request.url.endswith("/endorse") else None)
    officer.route("**/api/v1/transactions/proposals", lie)
    place(officer, f"drones/{DRONE}/suspend")
    officer.get_by_label("Reason").fill("x")
    sign(officer)
    expect(officer.get_by_role("alert")).to_contain_text("other bytes to sign than you asked for")
    assert endorsed == []


def test_a_list_with_errors(console_house, officer, tmp_path):
    lines = [
        "uav_id;model;operator_id;registration",
        f"{DRONE};m;o;",
        "NEW-1;Falcon;arctic-air;",
        "BAD 1;;o;",
        "NEW-2;Räven;arctic-air;FIN87",
    ]
    file = tmp_path / "drones.csv"
    file.write_bytes("\r\n".join(lines).encode("cp1252"))
    place(officer, "import")
    officer.get_by_label("CSV file").set_input_files(file)
    officer.get_by_role("button", name="Check the file").click()
    expect(officer.get_by_text("2 lines can be signed, 1 is on the ledger already")).to_contain_text("Windows-1252")
    expect(officer.get_by_role("row").filter(has_text="model")).to_contain_text("4")
    officer.get_by_role("button", name="Go on with 2 lines").click()
    officer.reload()
    officer.get_by_role("button", name="Sign and send 2 lines").click()
    expect(officer.get_by_text("2 of 2 done: 2 valid, 0 refused.")).to_be_visible()
    with officer.expect_download() as download:
        officer.get_by_role("button", name="Download the report").click()
    report = Path(download.value.path()).read_text("utf-8-sig")
    assert re.search(r"3,NEW-1,valid,[0-9a-f]{64},VALID", report)
    place(officer, "drones?q=NEW-2")
    expect(officer.get_by_role("row").filter(has_text="NEW-2")).to_contain_text("Räven")


def test_bringing_a_certificate_and_its_key(console_house, open_page, tmp_path):
    files = console_house.connection.files("inspector")
    page = open_page(console_house.link("Inka", ("inspector",)), room="registry")
    expect(page.get_by_role("link", name="Registry")).to_be_visible()
    place(page, "key")
    form = page.locator("section").filter(has_text="Bring a certificate and its key")
    form.get_by_label("Organisation").fill("AuthorityMSP")
    form.get_by_label("Certificate (PEM)").set_input_files(files.certificate)
    wrong = tmp_path / "wrong.key"
    wrong.write_text("-----BEGIN ENCRYPTED PRIVATE KEY-----\nAAAA\n-----END ENCRYPTED PRIVATE KEY-----\n")
    form.get_by_label("Private key (PEM, not encrypted)").set_input_files(wrong)
    form.get_by_role("button", name="Bring it").click()
    expect(form.get_by_role("alert")).to_contain_text("encrypted")
    page.watched.expected = ("400",)
    form.get_by_label("Private key (PEM, not encrypted)").set_input_files(console_house.connection.files("pad").key)
    form.get_by_role("button", name="Bring it").click()
    expect(form.get_by_role("alert")).to_contain_text("does not fit the certificate")
    form.get_by_label("Private key (PEM, not encrypted)").set_input_files(files.key)
    form.get_by_role("button", name="Bring it").click()
    expect(page.get_by_text("in use")).to_be_visible()
    place(page, f"drones/{DRONE}/suspend")
    page.get_by_label("Reason").fill("By a key that was there before")
    sign(page)
    expect(page.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
