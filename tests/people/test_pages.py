"""The console's pages of people in Chromium with its virtual authenticator, on a real backend."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

FRONTEND = Path(__file__).resolve().parents[2] / "frontend"
AXE = FRONTEND / "node_modules" / "axe-core" / "axe.min.js"
pytestmark = pytest.mark.browser


def authenticate(page):
    """A platform authenticator that verifies its user, as a laptop has one."""
    session = page.context.new_cdp_session(page)
    session.send("WebAuthn.enable")
    options = {
        "protocol": "ctap2",
        "transport": "internal",
        "hasResidentKey": True,
        "hasUserVerification": True,
        "isUserVerified": True,
        "automaticPresenceSimulation": True,
    }
    made = session.send("WebAuthn.addVirtualAuthenticator", {"options": options})
    return session, made["authenticatorId"]


def set_up(open_page, server, **options):
    """The first administrator, at her account."""
    page = open_page(server.url, **options)
    page.watched.expected = ("status of 403", "status of 401")
    authenticate(page)
    page.goto(server.set_up_link())
    page.reload()
    page.get_by_label("Your name").fill("Ada Lovelace")
    page.get_by_role("button", name="Make a passkey and sign in").click()
    expect(page.get_by_role("navigation", name="Pages")).to_be_visible()
    return page


def test_set_up_sign_out_and_in_again_by_passkey(open_page, server):
    page = open_page(server.url)
    page.watched.expected = ("status of 403", "status of 401")
    expect(page.get_by_text("This server has not been set up yet.")).to_be_visible()
    page.close()
    page = set_up(open_page, server)
    page.get_by_role("button", name="Sign out").click()
    page.get_by_role("button", name="Sign in with a passkey").click()
    expect(page.get_by_role("link", name="Ada Lovelace")).to_be_visible()
    page.get_by_role("link", name="Ada Lovelace").click()
    card = page.get_by_role("region", name="Passkeys")
    expect(card.get_by_text("last used")).to_be_visible()
    card.get_by_role("button", name="Remove the passkey").click()
    page.watched.expected += ("status of 409",)
    expect(card.get_by_role("alert")).to_contain_text("your only way to sign in")


def test_a_cancelled_passkey_is_said_in_words(open_page, server):
    page = set_up(open_page, server)
    page.get_by_role("button", name="Sign out").click()
    page.get_by_role("button", name="Sign in with a passkey").wait_for()
    page.evaluate(
        "() => { navigator.credentials.get = async () => { throw new DOMException('', 'NotAllowedError'); }; }"
    )
    page.get_by_role("button", name="Sign in with a passkey").click()
    expect(page.get_by_role("alert")).to_contain_text("cancelled")
    page.get_by_role("button", name="Kieli").or_(page.get_by_role("button", name="Language")).click()
    expect(page.get_by_role("button", name="Kirjaudu pääsyavaimella")).to_be_visible()


def test_invite_change_suspend_and_find_it_in_the_log(open_page, server):
    page = set_up(open_page, server)
    page.goto(f"{server.url}/#/people/invite")
    page.get_by_label("Name", exact=True).fill("<b>Grace</b> Höpper")
    page.get_by_label("Inspector").check()
    page.get_by_label("Viewer").uncheck()
    page.get_by_role("button", name="Make the invitation").click()
    link = page.get_by_test_id("made-link").inner_text()

    other = open_page(link)
    other.watched.expected = ("status of 401", "status of 403")
    authenticate(other)
    expect(other.get_by_text("Welcome, <b>Grace</b> Höpper")).to_be_visible()
    other.get_by_role("button", name="Make a passkey and sign in").click()
    expect(other.get_by_role("link", name="<b>Grace</b> Höpper")).to_be_visible()
    other.goto(f"{server.url}/#/people/audit")
    expect(other.get_by_role("region", name="Where you are signed in")).to_be_visible()
    expect(other.get_by_role("navigation", name="Parts of this room")).to_have_count(0)

    page.get_by_role("button", name="Done").click()
    page.get_by_role("link", name="<b>Grace</b> Höpper").click()
    page.get_by_label("Viewer").check()
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_role("status")).to_contain_text("Saved")
    page.get_by_role("button", name="Suspend").click()
    expect(page.get_by_text("suspended", exact=True)).to_be_visible()
    expect(other.get_by_role("button", name="Sign in with a passkey")).to_be_visible(timeout=30_000)

    page.get_by_role("link", name="Audit log").click()
    rows = page.get_by_role("row")
    expect(rows.nth(1)).to_contain_text("suspended an account")
    page.get_by_label("Act").select_option("passkey_added")
    expect(rows).to_have_count(3)
    page.get_by_role("button", name="Check the log").click()
    expect(page.get_by_role("status").filter(has_text="as they were written")).to_be_visible()
    page.reload()
    expect(page.get_by_label("Act")).to_have_value("passkey_added")


def test_two_administrators_and_one_account(open_page, server):
    page = set_up(open_page, server)
    page.watched.expected += ("status of 409",)
    server.invite("Grace")
    page.goto(f"{server.url}/#/people")
    page.get_by_role("link", name="Grace").click()
    page.get_by_label("Name", exact=True).fill("Grace H.")
    server.rename("Grace", "Grace Hopper")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_role("alert")).to_contain_text("Somebody else has changed this account")
    expect(page.get_by_label("Name", exact=True)).to_have_value("Grace H.")
    expect(page.get_by_role("heading", name="Grace Hopper")).to_be_visible()
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_role("heading", name="Grace H.", exact=True)).to_be_visible()


# The other pages of the room: tests/console/test_accessibility.py.
PLACES = ["people/invite", "people/PERSON", ""]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_every_page_is_accessible(open_page, server, theme, width):
    if not AXE.is_file():
        pytest.skip("axe-core is not installed (make setup)")
    page = set_up(open_page, server, theme=theme, width=width)
    person = server.invite("Grace")
    found = {}
    for place in PLACES:
        if not place:
            page.evaluate("fetch('/api/v1/session', {method: 'DELETE'})")
            page.goto(f"{server.url}/#/people")
            page.reload()
            page.get_by_role("button", name="Sign in with a passkey").wait_for()
        else:
            page.goto(f"{server.url}/#/{place.replace('PERSON', person)}")
            page.get_by_role("heading", level=1).wait_for()
            expect(page.get_by_text("Fetching…")).to_have_count(0)
        page.evaluate(AXE.read_text())
        result = page.evaluate(
            "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice']})"
        )
        broken = [(each["id"], [node["html"][:160] for node in each["nodes"]]) for each in result["violations"]]
        if broken:
            found[place] = broken
        wide = page.evaluate("document.querySelector('main').scrollWidth > document.querySelector('main').clientWidth")
        assert not wide, f"{place} is wider than the screen"
    assert found == {}


def test_a_link_that_is_none(open_page, server):
    page = set_up(open_page, server)
    page.get_by_role("button", name="Sign out").click()
    page.get_by_role("button", name="Sign in with a passkey").wait_for()
    page.goto(f"{server.url}/#token=nonsense")
    page.reload()
    expect(page.get_by_role("alert")).to_contain_text("used before")
    page.goto(f"{server.url}/#refused=unknown")
    page.reload()
    expect(page.get_by_role("alert")).to_contain_text("Nobody has invited you")
    assert not re.search("token|refused", page.url)
