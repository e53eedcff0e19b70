"""WCAG 2.2 AA by axe on every page, both themes and three sizes, on a real backend and ledger; no page is wider than its
window. How one gets in (set-up, invitation, recovery, passkeys): tests/people/test_pages.py."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest
from kit import barriers
from kit.houses import HONEST, LIAR
from playwright.sync_api import expect

ZONES = Path(__file__).resolve().parents[1] / "zones" / "files"
DRONE, PAD = "OH-DRN-0417", "aurajoki-2"
UNKNOWN = "f" * 64


def at_rest(page):
    """The room is there, and nothing is being fetched for it."""
    expect(page.locator("main.room")).to_be_visible()
    page.wait_for_load_state("networkidle")
    # A room that is not yet loaded has none of these.
    expect(page.locator("main.room :is(h1, h2, table, [role=alert])").first).to_be_visible()
    expect(page.locator(".empty").filter(has_text="Fetching")).to_have_count(0)


def export(page):
    page.get_by_role("button", name="Export…").click()
    expect(page.locator("dialog[open]")).to_be_visible()


def keys(page):
    page.keyboard.press("?")
    expect(page.locator("dialog[open]")).to_be_visible()


def searched(page):
    page.get_by_role("combobox", name="Search").fill("uav")
    expect(page.get_by_role("search").get_by_role("option").first).to_be_visible()


def signing(page):
    """The last look before a change is signed."""
    page.get_by_label("Reason").fill("To be looked at")
    page.get_by_role("button", name="Check and sign").click()
    expect(page.get_by_role("button", name="Sign and send")).to_be_visible()


def faulty(page):
    page.get_by_role("button", name="Check and sign").click()
    expect(page.locator(".field-error").first).to_be_visible()


def zones_with_errors(page):
    page.get_by_label("Source").fill("turku")
    page.locator("input[type=file]").set_input_files(ZONES / "broken.ed318.json")
    page.get_by_role("button", name="Check").click()
    expect(page.get_by_role("alert")).to_contain_text("16 errors")


def drones_with_errors(page):
    text = b"uav_id;model;operator_id;registration\r\nBAD 1;;o;\r\nNEW-1;Falcon;arctic-air;\r\n"
    page.get_by_label("CSV file").set_input_files({"name": "drones.csv", "mimeType": "text/csv", "buffer": text})
    page.get_by_role("button", name="Check the file").click()
    expect(page.get_by_role("button", name="Go on with 1 line")).to_be_visible()


def imported(page):
    drones_with_errors(page)
    page.get_by_role("button", name="Go on with 1 line").click()
    page.get_by_role("button", name="Sign and send 1 line").click()
    expect(page.get_by_text("1 of 1 done")).to_be_visible()


def link_made(page):
    page.get_by_label("Name", exact=True).fill("Grace Hopper")
    page.get_by_role("button", name="Make the invitation").click()
    expect(page.get_by_test_id("made-link")).to_be_visible()


def secret_made(page):
    page.get_by_role("button", name="Register a machine").click()
    page.get_by_label("Name").fill("City traffic room")
    page.get_by_role("checkbox", name="Landing pads and their health").check()
    page.get_by_role("button", name="Register a machine").click()
    expect(page.get_by_test_id("client-secret")).to_be_visible()


def filters(page):
    if page.locator(".filters").count() == 0:
        page.get_by_role("button", name="Filter", exact=True).click()


def tour_in_the_ledger(page):
    page.get_by_role("button", name="Show the tour again").click()
    for _ in range(4):
        page.locator(".tour").get_by_role("button", name="Next").click()
    expect(page.get_by_role("heading", name="Ledger")).to_be_visible()


# The map takes seconds to be drawn anew at another size: all of its places at one size, then the next.
MAP = [
    ("live?networked", None),
    ("live?list=pads", None),
    ("live", filters),
    ("live?measure=60.4518,22.2666;60.4520,22.2670", None),
    (f"live?drone={LIAR}", None),
    (f"live?drone={HONEST}", None),
    ("live?table", None),
    ("live?wall", None),
]
# Every other page by its address, and what is done there before it is looked at.
PLACES = {
    "past": [
        ("replay?t={moment}&session={session}", None),
        ("replay?t={moment}", export),
        ("statistics", None),
        ("statistics?day={day}", None),
        ("statistics?day=2020-02-29", None),
        ("settings", None),
        ("settings", keys),
        ("settings", searched),
        ("settings", tour_in_the_ledger),
    ],
    "proofs": [
        ("sessions", None),
        ("sessions/{session}", None),
        (f"sessions/{UNKNOWN}", None),
        ("verdicts", None),
        ("verdicts?outcome=inconclusive", None),
        ("alerts", None),
        ("alerts/{alert}", None),
        ("alerts?state=over", None),
        ("ledger", None),
        ("ledger/block/{block}", None),
        ("ledger/transaction/{tx}", None),
        (f"ledger/transaction/{UNKNOWN}", None),
    ],
    "registry": [
        ("registry/drones", None),
        (f"registry/drones/{DRONE}", None),
        ("registry/drones/NOBODY", None),
        ("registry/drones/new", faulty),
        (f"registry/drones/{DRONE}/suspend", signing),
        (f"registry/drones/{DRONE}/grant", None),
        (f"registry/drones/{DRONE}/maintenance", None),
        ("registry/pads", None),
        (f"registry/pads/{PAD}", None),
        (f"registry/pads/{PAD}/policy/land", None),
        (f"registry/pads/{PAD}/commission", None),
        ("registry/pads/new", None),
        ("registry/operators", None),
        ("registry/certificates", None),
        ("registry/import", drones_with_errors),
        ("registry/import", imported),
        ("registry/key", None),
    ],
    "people and zones": [
        ("people", None),
        ("people/{person}", None),
        ("people/invite", None),
        ("people/invite", link_made),
        ("people/clients", None),
        ("people/clients", secret_made),
        ("people/audit", None),
        ("people/me", None),
        ("zones/import", zones_with_errors),
        ("zones", None),
        ("zones/pads/aurajoki-2", None),
        ("zones/list", None),
        ("zones/list/FIN:P20", None),
    ],
}


@pytest.fixture
def names(with_liar):
    """What the addresses name: the refuted proof and what belongs to it, an invited person, imported zones."""
    admin = with_liar.person("Bo", "admin")
    zones = (ZONES / "turku.ed318.json").read_bytes()
    assert admin.http.post("/api/v1/zones/imports", params={"source": "t"}, content=zones).is_success
    verdict = admin.get("/verdicts", params={"drone": LIAR}).json()["items"][0]
    person = admin.post("/people", {"name": "Grace", "roles": ["inspector"]}).json()["person"]
    moment = datetime.fromtimestamp(verdict["decided_ms"] / 1000).astimezone()
    return {
        "url": f"{with_liar.url}/#/settings",
        "session": verdict["session_id"],
        "tx": verdict["tx_id"],
        "block": admin.get("/blocks").json()["items"][0]["number"],
        "alert": admin.get("/alerts").json()["items"][0]["alert_id"],
        "person": person["person_id"],
        "moment": moment.isoformat(timespec="seconds").replace("+", "%2B"),
        "day": moment.date().isoformat(),
    }


@pytest.fixture
def page(with_liar, open_page):
    """Of an administrator who can sign."""
    page = open_page(with_liar.link(), room="registry/key")
    page.watched.expected = ("404",)  # Some addresses name what there is not.
    page.get_by_role("button", name="Use the demo’s administrator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    return page


def go(page, address, prepare):
    """There, and what is done there; the name of it."""
    page.evaluate("(hash) => { location.hash = hash; }", f"#/{address}")
    at_rest(page)
    if prepare:
        prepare(page)
    return f"{address} {prepare.__name__ if prepare else ''}"


@pytest.mark.timeout(300)
def test_the_map_is_free_of_barriers_and_fits(page):
    found = []
    for look, only in barriers.looks(page):
        for address, prepare in MAP:
            place = go(page, address, prepare)
            found += [f"{place}, {look}: {each}" for each in barriers.on(page, only)]
        page.keyboard.press("Escape")  # leaves the wall
    assert found == [], "\n".join(found)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("group", PLACES)
def test_every_page_is_free_of_barriers_and_fits(page, names, group):
    found = []
    for address, prepare in PLACES[group]:
        if prepare:
            page.goto("about:blank")
            page.goto(names["url"])
        place = go(page, address.format(**names), prepare)
        found += [f"{place}: {each}" for each in barriers.anywhere(page)]
    assert found == [], "\n".join(found)


def test_whoever_is_not_signed_in_meets_no_barrier(console_house, open_page):
    page = open_page(console_house.url)
    page.watched.expected = ("401", "403")  # so it learns that nobody is signed in
    expect(page.get_by_role("main")).to_be_visible()
    assert barriers.anywhere(page) == []
