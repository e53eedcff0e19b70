"""The console on a bad line: a real backend behind a cable that is pulled, or cut again and again."""

from __future__ import annotations

import pytest
from kit.cable import Cable
from playwright.sync_api import expect

# The browser itself reports these; the page says the same in its banner.
LOST = ("WebSocket connection to", "Failed to load resource")
DROPS = 4


@pytest.fixture
def cable(real):
    made = Cable(real.port)
    real._run(made.open())
    yield made
    real._run(made.close())


@pytest.fixture
def far(real, cable, open_page):
    page = open_page(real.link().replace(str(real.port), str(cable.port)))
    page.watched.expected = LOST
    expect(page.get_by_role("option")).to_have_count(2)
    return page


def refuse(real, name):
    facts, now_ms = real.facts, real.now_ms()
    real.add(facts.put_uav(name), facts.request(name, uav_id=name, t_ms=now_ms))
    real.add(facts.decide(name, uav_id=name, t_ms=now_ms, outcome="refuted"))


def test_a_pulled_cable_closes_no_socket_and_is_told_all_the_same(real, cable, far):
    ledger = far.locator(".header .chip").filter(has_text="blocks")
    expect(ledger).to_contain_text("up to date")
    cable.is_pulled = True
    banner = far.get_by_role("alert").filter(has_text="Not connected")
    expect(banner).to_contain_text("old")
    expect(ledger).to_contain_text("not connected")
    refuse(real, "uav-3")
    # What was sent into the pulled cable is lost, and the old connections with it.
    real._run(cable.cut())
    cable.is_pulled = False
    expect(far.get_by_role("option").filter(has_text="uav-3")).to_contain_text("Refuted at Aurajoki 2")
    expect(banner).to_have_count(0)
    expect(ledger).to_contain_text("up to date")


def test_a_socket_that_drops_again_and_again_loses_no_alert(real, cable, far):
    chip = far.get_by_test_id("alerts-chip")
    expect(chip).to_contain_text("1 alert")
    for drop in range(DROPS):
        with far.expect_websocket(lambda socket: "/live" in socket.url):
            real._run(cable.cut())
            refuse(real, f"uav-{drop + 3}")
        expect(chip).to_contain_text(f"{drop + 2} alerts")
    chip.click()
    for number in range(2, DROPS + 3):
        expect(far.get_by_role("link", name="Refuted").filter(has_text=f"uav-{number}")).to_have_count(1)
    # And the picture is the present.
    blocks = real._run(real._make(lambda: real.chain.height))
    expect(far.locator(".header .chip").filter(has_text="blocks")).to_contain_text(f"{blocks} blocks · up to date")
