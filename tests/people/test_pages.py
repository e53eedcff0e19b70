"""The console's pages of people in Chromium with its virtual authenticator, on a real backend."""

from __future__ import annotations

import os
import re

import pytest
from kit import barriers
from playwright.sync_api import expect

pytestmark = pytest.mark.browser
CONFIRM = "Confirm with the passkey"


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


MAKE = """async ([path, body]) => {
    const post = (to, what, more = {}) => fetch(to, { method: "POST", body: what && JSON.stringify(what),
        headers: { ...(what && { "Content-Type": "application/json" }), ...more } }).then((answer) => answer.json());
    const bytes = new TextEncoder().encode(body ? JSON.stringify(body) : "");
    const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
    const body_sha256 = Array.from(digest, (each) => each.toString(16).padStart(2, "0")).join("");
    const asked = await post("/api/v1/step-up/challenge", { method: "POST", path, body_sha256 });
    const publicKey = PublicKeyCredential.parseRequestOptionsFromJSON(asked.options);
    const credential = (await navigator.credentials.get({ publicKey })).toJSON();
    const { token } = await post("/api/v1/step-up", { ceremony: asked.ceremony, credential });
    return post(path, body, { "Step-Up": token });
}"""
"""Makes something by the interface, confirmed by the page's passkey."""


def set_up(open_page, server, before=lambda page: None, *, confirms=True):
    """The first administrator, at her account; `before` looks at the page that leads there.

    `confirms`: whenever she is asked once more for her passkey.
    """
    page = open_page(server.url)
    page.watched.expected = ("status of 403", "status of 401")
    authenticate(page)
    page.goto(server.set_up_link())
    page.reload()
    before(page)
    page.get_by_label("Your name").fill("Ada Lovelace")
    page.get_by_role("button", name="Make a passkey and sign in").click()
    expect(page.get_by_role("navigation", name="Pages")).to_be_visible()
    if confirms:
        page.add_locator_handler(page.get_by_role("button", name=CONFIRM), lambda button: button.click())
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
    expect(page.get_by_test_id("made-link")).to_be_visible()
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
    expect(rows.filter(has_text="suspended an account")).to_have_count(1)
    page.get_by_label("Act").select_option("passkey_added")
    expect(rows).to_have_count(3)
    page.get_by_role("button", name="Check the log").click()
    expect(page.get_by_role("status").filter(has_text="as they were written")).to_be_visible()
    page.reload()
    expect(page.get_by_label("Act")).to_have_value("passkey_added")


def test_what_weighs_most_is_confirmed_and_nothing_typed_is_lost(open_page, server):
    page = set_up(open_page, server, confirms=False)
    page.goto(f"{server.url}/#/people/invite")
    page.get_by_label("Name", exact=True).fill("Grace Höpper")
    invite = page.get_by_role("button", name="Make the invitation")
    invite.click()
    dialog = page.get_by_role("dialog", name="Is it you?")
    expect(dialog.get_by_role("button", name=CONFIRM)).to_be_focused()
    assert barriers.anywhere(page) == []
    if (directory := os.environ.get("WONDERLAND_SCREENS")) is not None:
        page.screenshot(path=f"{directory}/step-up.png")
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    expect(page.get_by_role("alert")).to_contain_text("passkey once more")
    expect(page.get_by_label("Name", exact=True)).to_have_value("Grace Höpper")
    # Somebody who changes her mind at the authenticator can still go on.
    page.evaluate("() => { window.get = navigator.credentials.get.bind(navigator.credentials); }")
    page.evaluate(
        "() => { navigator.credentials.get = async () => { throw new DOMException('', 'NotAllowedError'); }; }"
    )
    invite.click()
    dialog.get_by_role("button", name=CONFIRM).click()
    expect(dialog.get_by_role("alert")).to_contain_text("cancelled")
    page.evaluate("() => { navigator.credentials.get = window.get; }")
    dialog.get_by_role("button", name=CONFIRM).click()
    expect(page.get_by_test_id("made-link")).to_be_visible()
    page.goto(f"{server.url}/#/people/audit")
    expect(page.get_by_role("row").filter(has_text="confirmed by passkey")).to_have_count(1)
    page.get_by_role("button", name="Language").click()
    page.goto(f"{server.url}/#/people/invite")
    page.get_by_label("Nimi", exact=True).fill("Aino")
    page.get_by_role("button", name="Tee kutsu").click()
    dialog = page.get_by_role("dialog", name="Oletko se sinä?")
    expect(dialog).to_be_visible()
    if directory is not None:
        page.screenshot(path=f"{directory}/step-up-fi.png")
    dialog.get_by_role("button", name="Vahvista pääsyavaimella").click()
    expect(page.get_by_test_id("made-link")).to_be_visible()


def test_a_lost_passkey_and_the_link_that_gives_the_account_back(open_page, server):
    page = set_up(open_page, server)
    made = page.evaluate(MAKE, ["/api/v1/people", {"name": "Grace", "roles": ["viewer"]}])

    def accept(link):
        """With a new authenticator: in a browser of its own."""
        other = open_page(link)
        other.watched.expected = ("status of 401", "status of 403")
        authenticate(other)
        other.get_by_role("button", name="Make a passkey and sign in").click()
        expect(other.get_by_role("link", name="Grace")).to_be_visible()
        return other

    before = accept(f"{server.url}/#token={made['token']}")
    page.goto(f"{server.url}/#/people")
    page.get_by_role("link", name="Grace").click()
    page.get_by_role("button", name="Recovery link").click()
    expect(page.get_by_test_id("made-link")).to_be_visible()
    link = page.get_by_test_id("made-link").inner_text()
    after = accept(link)

    # Whoever has the lost device is not signed in any more; the new one is.
    after.get_by_role("link", name="Grace").click()
    expect(after.get_by_role("region", name="Passkeys").get_by_text("This device").first).to_be_visible()
    before.reload()
    expect(before.get_by_role("button", name="Sign in with a passkey")).to_be_visible()
    again = open_page(link)
    again.watched.expected = ("status of 401", "status of 403")
    expect(again.get_by_role("alert")).to_contain_text("used before")


def test_ending_a_sign_in_elsewhere(open_page, server):
    other, page = (open_page(server.link("Grace"), room="people/me") for _ in range(2))
    other.watched.expected = ("status of 401", "status of 403")
    expect(other.get_by_role("region", name="Where you are signed in")).to_be_visible()
    page.get_by_role("button", name="Sign out there").click()
    expect(page.get_by_role("button", name="Sign out there")).to_have_count(0)
    expect(other.get_by_role("navigation", name="Pages")).to_have_count(0)
    expect(other.get_by_text("Is it where it says?")).to_be_visible()


def test_signing_in_by_a_real_openid_provider(open_page, oidc_server):
    server = oidc_server
    admin = open_page(server.link("Ada", "admin"), room="people/me")
    admin.watched.expected = ("status of 403",)
    authenticate(admin)
    admin.get_by_role("button", name="Add a passkey").click()
    expect(admin.get_by_role("region", name="Passkeys").get_by_role("listitem")).to_have_count(1)
    admin.goto(f"{server.url}/#/people/invite")
    admin.get_by_label("Name", exact=True).fill("Grace")
    admin.get_by_label("E-mail").fill("grace@example.org")
    admin.get_by_role("button", name="Make the invitation").click()
    admin.get_by_role("button", name=CONFIRM).click()
    expect(admin.get_by_test_id("made-link")).to_be_visible()

    page = open_page(server.url)
    # The provider's own pages are elsewhere, and know nothing of this browser's rules.
    page.watched.expected = ("status of 401", "status of 403", "request to http", "NAME_NOT_RESOLVED", "404")

    def log_in(name):
        page.get_by_role("button", name="Continue with Example").click()
        page.get_by_placeholder("login").fill(name)
        page.get_by_placeholder("password").fill("any")
        page.get_by_role("button", name="Sign-in").click()
        page.get_by_role("button", name="Continue").click()

    log_in("mallory")
    expect(page.get_by_role("alert")).to_contain_text("Nobody has invited you")
    page.context.clear_cookies()
    log_in("grace")
    expect(page.get_by_role("link", name="Grace")).to_be_visible()
    page.get_by_role("link", name="Grace").click()
    expect(page.get_by_role("region", name="Where you are signed in")).to_contain_text("by single sign-on")


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


def test_no_way_in_has_a_barrier(open_page, server):
    """Set-up, sign-in, invitation, recovery. The pages behind them: tests/console/test_accessibility.py."""
    page = open_page(server.url)
    page.watched.expected = ("status of 403", "status of 401")
    expect(page.get_by_text("This server has not been set up yet.")).to_be_visible()
    found = {"not set up": barriers.anywhere(page)}
    page.close()

    def look(page):
        expect(page.get_by_role("button", name="Make a passkey and sign in")).to_be_visible()
        found[page.get_by_role("main").inner_text()] = barriers.anywhere(page)

    page = set_up(open_page, server, before=look)
    page.goto(f"{server.url}/#/people/me")
    expect(page.get_by_role("region", name="Passkeys").get_by_role("listitem")).to_have_count(1)
    found["account"] = barriers.anywhere(page)
    made = page.evaluate(MAKE, ["/api/v1/people", {"name": "Grace", "roles": ["viewer"]}])
    myself = page.evaluate("fetch('/api/v1/me').then((answer) => answer.json())")["person"]["person_id"]
    recovery = page.evaluate(MAKE, [f"/api/v1/people/{myself}/link", None])
    page.get_by_role("button", name="Sign out").first.click()
    expect(page.get_by_role("button", name="Sign in with a passkey")).to_be_visible()
    found["sign in"] = barriers.anywhere(page)
    for link in (made, recovery):
        page.goto(f"{server.url}/#token={link['token']}")
        page.reload()
        look(page)
    assert len(found) == 6
    assert not any(found.values()), found


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
