"""The inbox of alerts in Chromium on a real backend: found at once, acted upon with a name, nothing overwritten."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from wonderland_backend.alerts import store
from wonderland_backend.db import bulk
from wonderland_backend.db.tables.reported import HealthRow


@pytest.fixture
def inbox(real, open_page):
    page = open_page(real.link(), room="alerts")
    expect(page.get_by_role("heading", name="Alerts", exact=True)).to_be_visible()
    expect(row(page)).to_be_visible()
    return page


def row(page):
    return page.get_by_role("link", name="Refuted")


def test_from_the_header_to_why(real, open_page):
    inbox = open_page(real.link())
    expect(inbox.get_by_role("option")).to_have_count(2)
    inbox.get_by_test_id("alerts-chip").click()
    expect(inbox.get_by_role("heading", name="Alerts", exact=True)).to_be_visible()
    row(inbox).click()
    panel = inbox.get_by_role("region", name="Alerts", exact=True)
    expect(panel.locator(".told")).to_contain_text("uav-2 is not where it says: measured")
    expect(panel.locator(".told")).to_contain_text("from its claim at Aurajoki 2")
    panel.get_by_role("link", name="Explain").click()
    expect(inbox.get_by_role("heading", level=2).first).to_have_text("Refuted")
    inbox.go_back()
    expect(panel.locator(".told")).to_be_visible()


def test_all_are_counted_also_those_that_the_page_was_not_sent(real, open_page, monkeypatch):
    monkeypatch.setattr(store, "MAX_OPEN", 2)
    facts, now_ms = real.facts, real.now_ms()
    names = [f"more-{index}" for index in range(3)]
    real.add(*(facts.request(name, uav_id="uav-2", t_ms=now_ms) for name in names))
    real.add(*(facts.decide(name, uav_id="uav-2", t_ms=now_ms, outcome="refuted") for name in names))
    page = open_page(real.link(), room="alerts")
    chip = page.get_by_test_id("alerts-chip")
    expect(chip).to_contain_text("4 alerts")
    page.get_by_role("button", name="Acknowledge", exact=True).click()
    expect(chip).to_contain_text("3 alerts")


def test_an_acknowledgement_has_a_name_and_a_note_and_stays(inbox):
    row(inbox).click()
    inbox.get_by_label("Note").fill("Called the operator. <b>Not</b> markup.")
    inbox.get_by_role("button", name="Acknowledge", exact=True).click()
    expect(inbox.get_by_text("acknowledged by")).to_be_visible()
    expect(inbox.locator(".act-note")).to_have_text("Called the operator. <b>Not</b> markup.")
    expect(inbox.get_by_test_id("alerts-chip")).to_have_count(0)
    expect(inbox.get_by_text("Nothing needs you.")).to_be_visible()
    inbox.get_by_role("button", name="Acknowledged").click()
    inbox.reload()
    row(inbox).click()
    inbox.get_by_role("button", name="Open again").click()
    expect(inbox.get_by_test_id("alerts-chip")).to_contain_text("1 alert")


def test_two_officers_and_one_alert(real, open_page, inbox):
    row(inbox).click()
    other = open_page(f"{real.link()}")
    other.get_by_test_id("alerts-chip").click()
    row(other).click()
    expect(other.get_by_role("button", name="Take it")).to_be_visible()
    inbox.get_by_role("button", name="Take it").click()
    expect(inbox.get_by_text("assigned to").first).to_be_visible()
    other.watched.expected = ("409",)
    other.get_by_label("Note").fill("my own finding")
    other.get_by_role("button", name="Add note").click()
    expect(other.get_by_role("alert").filter(has_text="Somebody else has acted")).to_be_visible()
    expect(other.get_by_label("Note")).to_have_value("my own finding")
    other.get_by_role("button", name="Add note").click()
    expect(other.locator(".act-note")).to_have_text("my own finding")


def test_a_new_alert_is_said_to_screen_readers_and_counted(real, inbox):
    facts, now_ms = real.facts, real.now_ms()
    real.add(facts.request("nine", uav_id="uav-2", t_ms=now_ms))
    real.add(facts.decide("nine", uav_id="uav-2", t_ms=now_ms, outcome="refuted"))
    expect(inbox.get_by_test_id("alerts-chip")).to_contain_text("2 alerts")
    expect(inbox.get_by_role("log")).to_contain_text("uav-2 is not where it says")
    expect(row(inbox)).to_have_count(2)


async def report_health(database, t_ms):
    row = {"agent": "pad", "agent_id": "pad-1", "t_ms": t_ms, "body": "{}"}
    async with database.write() as connection:
        await bulk.upsert(connection, HealthRow, [row])


def test_what_ended_by_itself_stays_until_somebody_has_seen_it(real, inbox):
    database, watch = real.backend.database, real.backend.watch
    real._run(report_health(database, real.now_ms() - 120_000))
    real._run(watch.look_once())
    silent = inbox.get_by_role("link", name="Pad silent")
    expect(silent).to_be_visible()
    expect(silent).not_to_contain_text("over since")
    real._run(report_health(database, real.now_ms()))
    real._run(watch.look_once())
    expect(silent).to_contain_text("over since")
    expect(inbox.get_by_test_id("alerts-chip")).to_contain_text("2 alerts")
    inbox.reload()
    silent.click()
    expect(inbox.get_by_text("not acknowledged")).to_be_visible()
    inbox.get_by_role("button", name="Acknowledge", exact=True).click()
    expect(inbox.get_by_test_id("alerts-chip")).to_contain_text("1 alert")
    expect(silent).to_have_count(0)
    inbox.get_by_role("button", name="Over", exact=True).click()
    expect(silent).to_be_visible()


@pytest.fixture
def flapping(real, inbox):
    """The inbox, with three alerts of a pad that went and came back."""
    database, watch = real.backend.database, real.backend.watch
    for _ in range(3):
        real._run(report_health(database, real.now_ms() - 120_000))
        real._run(watch.look_once())
        real._run(report_health(database, real.now_ms()))
        real._run(watch.look_once())
    # A box to tick only where it is over, also on the page: before that, "the first two" are others than a moment later.
    expect(inbox.get_by_role("checkbox", name="Choose Pad silent")).to_have_count(3)
    return inbox


def several(page):
    return page.get_by_role("group", name="Several at once")


def test_what_a_pad_went_through_is_acknowledged_at_once_and_recorded_one_by_one(flapping):
    # What still goes on has to be looked at by itself.
    expect(flapping.get_by_role("checkbox", name="Choose Refuted")).to_have_count(0)
    several(flapping).get_by_role("button", name="All of Aurajoki 2 that are over").click()
    several(flapping).get_by_label("Note").fill("Its cable was loose.")
    several(flapping).get_by_role("button", name="Acknowledge these 3").click()
    expect(several(flapping)).to_contain_text("3 were acknowledged.")
    expect(flapping.get_by_role("link", name="Pad silent")).to_have_count(0)
    expect(flapping.get_by_test_id("alerts-chip")).to_contain_text("1 alert")
    flapping.get_by_role("button", name="Over", exact=True).click()
    silent = flapping.get_by_role("link", name="Pad silent")
    expect(silent).to_have_count(3)
    for index in range(3):
        silent.nth(index).click()
        expect(silent.nth(index)).to_have_attribute("aria-current", "true")
        expect(flapping.locator(".acts li")).to_have_count(1)
        expect(flapping.locator(".acts")).to_contain_text("M. Inspector acknowledged")
        expect(flapping.locator(".act-note")).to_have_text("Its cable was loose.")


def test_another_officer_who_was_first_is_told_of_and_nothing_is_overwritten(real, open_page, flapping):
    choices = flapping.get_by_role("checkbox", name="Choose Pad silent")
    for index in (0, 1):
        choices.nth(index).check()
    other = open_page(real.link(name="A. Nother"), room="alerts")
    other.get_by_role("link", name="Pad silent").first.click()
    other.get_by_label("Note").fill("I look into it.")
    other.get_by_role("button", name="Add note").click()
    expect(other.locator(".act-note")).to_be_visible()
    flapping.watched.expected = ("409",)
    several(flapping).get_by_role("button", name="Acknowledge these 2").click()
    expect(several(flapping)).to_contain_text("One was acknowledged.")
    told = several(flapping).get_by_role("alert")
    expect(told).to_contain_text("Somebody else has acted on this one meanwhile")
    told.get_by_role("link").click()
    expect(flapping.locator(".act-note")).to_have_text("I look into it.")
    expect(flapping.get_by_role("link", name="Pad silent", exact=False)).not_to_have_count(0)
    expect(flapping.get_by_role("button", name="Acknowledge", exact=True)).to_be_visible()


def test_what_sleeps_leaves_the_inbox(inbox):
    row(inbox).click()
    inbox.get_by_label("Snooze").select_option("60")
    expect(inbox.get_by_text("asleep until")).to_be_visible()
    expect(inbox.get_by_test_id("alerts-chip")).to_have_count(0)
    inbox.get_by_role("button", name="Snoozed").click()
    expect(row(inbox)).to_have_count(1)


def test_an_alert_is_given_to_another(inbox):
    row(inbox).click()
    inbox.get_by_label("Assign to").fill("Grace <b>Hopper</b>")
    inbox.get_by_role("button", name="Assign", exact=True).click()
    expect(inbox.get_by_text("assigned to Grace <b>Hopper</b>").first).to_be_visible()
    expect(inbox.locator(".acts").first).to_contain_text("M. Inspector assigned to Grace <b>Hopper</b>")
    expect(row(inbox)).to_contain_text("assigned to Grace <b>Hopper</b>")


# What the page gives to the loudspeaker and to the desktop, and goes on to.
LISTEN = """
window.told = [];
const heard = (name, say) => {
    window[name] = new Proxy(window[name], {
        construct(target, args) { window.told.push(say(...args)); return Reflect.construct(target, args); },
    });
};
heard("OscillatorNode", (_, { frequency }) => frequency);
heard("Notification", (title, { body }) => `${title}: ${body}`);
"""


def test_sound_and_desktop_notifications_come_when_asked_for(real, browser, open_page):
    context = browser.new_context(permissions=["notifications"])
    context.add_init_script(LISTEN)
    page = open_page(real.link(), context=context, room="alerts")
    expect(row(page)).to_have_count(1)

    def refute(name):
        facts, now_ms = real.facts, real.now_ms()
        real.add(facts.request(name, uav_id="uav-2", t_ms=now_ms))
        real.add(facts.decide(name, uav_id="uav-2", t_ms=now_ms, outcome="refuted"))

    refute("silent")
    expect(row(page)).to_have_count(2)
    assert page.evaluate("told") == [], "nobody has asked for it"
    page.get_by_label("Sound").check()
    page.get_by_label("Desktop").click()
    expect(page.get_by_label("Desktop")).to_be_checked()
    assert page.evaluate("told.splice(0)") == [660, 880], "one hears at once what it will be like"
    page.reload()
    expect(row(page)).to_have_count(2)
    refute("loud")
    expect(page.get_by_role("log")).to_contain_text("uav-2 is not where it says")
    first, second, said = page.evaluate("told")
    assert (first, second) == (660, 880)
    assert said.startswith("Refuted: uav-2 is not where it says: measured")
    context.close()
