"""A pad's queue in the console, on a real backend and ledger: seen, and changed by people who sign it."""

from __future__ import annotations

import json

import pytest
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature
from kit.contract import Scene
from playwright.sync_api import expect

from wonderland.proofs.records.policies import Policy

KEPT = {
    "occupied_ms": 3_600_000,
    "reservation_ms": 3_600_000,
    "session_ttl_ms": 120_000,
    "require_authorisation": False,
    "require_maintenance": False,
}


class Drone:
    """Signs as the ledger's own drone."""

    def __init__(self, connection):
        self.signer = connection.signer("uav")

    def sign(self, message):
        r, s = decode_dss_signature(self.signer(message))
        return r.to_bytes(32, "big") + s.to_bytes(32, "big")


@pytest.fixture
def queued(console_house):
    """uav-1 stands on pad-1 and asks for two more things; there is no other drone whose key is at hand."""
    scene = Scene()

    def send(*what):
        return json.loads(console_house.send(*what).payload)

    drone = Drone(console_house.connection)
    scene.channel = console_house.connection.channel
    scene.now_ms = console_house.now_ms()
    valid = {"valid_from_ms": scene.now_ms - 60_000, "valid_until_ms": scene.now_ms + 10**10}
    send("pad_operator", "RegisterPad", scene.pad_argument())
    send("pad_operator", "CommissionPad", {"pad_id": "pad-1", "commissioning": scene.commissioning(**valid)})
    proposed = send(
        "admin", "ProposePolicy", {"pad_id": "pad-1", "action": "*", "policy": Policy.parse(KEPT).to_json()}
    )
    send("inspector", "ApproveChange", Scene.approval(proposed))
    keys = [{"prekey_id": f"k{each}", "public_key": scene.point(60 + each)} for each in range(4)]
    send("pad", "PublishPrekeys", {"pad_id": "pad-1", "prekeys": keys})
    send("fleet_operator", "RegisterUav", scene.uav_argument("uav-1"))
    landed = send("uav", "RequestProof", scene.request_argument("k0"))
    verdict = send(
        "pad", "SubmitProof", {"session_id": landed["session_id"], "evidence": scene.evidence(landed, signer=drone)}
    )
    assert verdict["permission"] == "granted", verdict["reasons"]
    send("uav", "CompleteInteraction", {"session_id": landed["session_id"], "result": "done"})
    urgent = {"priority": "low_battery", "battery_percent": 9}
    waiting = [send("uav", "RequestProof", scene.request_argument("k1", action="dock"))]
    waiting.append(send("uav", "RequestProof", scene.request_argument("k2", **urgent)))
    console_house.wait_mirrored()
    return [each["session_id"] for each in waiting]


@pytest.fixture
def page(console_house, open_page, queued):
    page = open_page(console_house.link(), room="registry")
    page.evaluate("location.hash = '#/registry/key'")
    page.get_by_role("button", name="Use the demo’s administrator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    page.evaluate("location.hash = '#/registry/pads/pad-1'")
    return page


def sign(page):
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    expect(page.get_by_text("It is on the ledger, signed by you.")).to_be_visible()


def test_a_queue_is_seen_and_its_order_changed_by_people_who_sign(page):
    card = page.get_by_role("region", name="Queue")
    rows = card.get_by_role("listitem")
    expect(card).to_contain_text("uav-1 has stood on the pad for")
    expect(rows).to_have_count(2)
    expect(rows.nth(0)).to_contain_text("low battery, by its own word: 9 %")
    expect(rows.nth(1)).to_contain_text("as it came")
    rows.nth(1).get_by_role("link", name="Put first").click()
    page.get_by_label("Reason").fill("A patient on board")
    sign(page)
    expect(rows.nth(0)).to_contain_text("put first by")
    expect(rows.nth(0)).to_contain_text("A patient on board")
    rows.nth(1).get_by_role("link", name="Turn away").click()
    page.get_by_role("button", name="Check and sign").click()
    expect(page.get_by_text("Sign and send")).to_have_count(0)  # not without a reason
    page.get_by_label("Note").fill("The pad is being cleaned")
    sign(page)
    expect(rows).to_have_count(1)
    card.get_by_role("link", name="It has left the pad").click()
    sign(page)
    expect(card).not_to_contain_text("has stood on the pad")


def test_the_map_says_who_has_the_pad_and_how_many_wait(page):
    page.evaluate("location.hash = '#/live'")
    page.get_by_role("button", name="Pads 2").click()
    pads = page.get_by_role("list", name="Pads")
    expect(pads).to_contain_text("never heard from · uav-1 stands on it, 2 wait")


def test_a_pad_is_reserved_and_the_reservation_cancelled(page):
    card = page.get_by_role("region", name="Queue")
    card.get_by_role("link", name="Reserve").click()
    page.get_by_label("Serial number").fill("uav-1")
    sign(page)
    kept = card.get_by_role("list", name="Reservations").get_by_role("listitem")
    expect(kept).to_have_count(1)
    expect(kept).to_contain_text("uav-1, ")
    kept.get_by_role("link", name="Cancel").click()
    sign(page)
    expect(kept).to_have_count(0)
