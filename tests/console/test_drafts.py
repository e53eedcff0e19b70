"""What was typed and not yet sent: a session that ends mid-form, another language, another person at the same desk."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

NAME = "Ada Lovelace"


ROOMS = {
    # form: (room, what opens it, label of the field)
    "note": ("alerts", "uav-2", "Note"),
    "assignee": ("alerts", "uav-2", "Assign to"),
    "invitation": ("people/invite", None, "Name"),
    "person": ("people", NAME, "E-mail"),
    "machine": ("people/clients", "Register", "Name"),
    "unmask": ("registry/drones/uav-1", "^Show$", "Why"),
}


def begun(page, form):
    """Opens a form and types into it."""
    _, opener, label = ROOMS[form]
    if opener is not None:
        page.locator("main a, main button").filter(has_text=re.compile(opener)).first.click()
    page.get_by_label(label).fill("half@a.sentence")


@pytest.fixture
def page(real, open_page, request):
    return open_page(real.link(NAME, role="admin"), room=ROOMS[request.node.callspec.params["form"]][0])


def end_the_session(page):
    page.watched.expected = ("401", "403")
    page.context.clear_cookies()
    page.reload()
    expect(page.get_by_text("Is it where it says?")).to_be_visible()


def sign_in(page, link, address):
    page.goto(link)
    page.reload()
    expect(page.get_by_role("navigation", name="Pages")).to_be_visible()
    page.goto(address)


@pytest.mark.parametrize("form", ROOMS)
def test_what_is_typed_survives_a_session_that_ends(real, page, form):
    begun(page, form)
    address = page.url
    end_the_session(page)
    sign_in(page, real.link(NAME, role="admin"), address)
    expect(page.get_by_label(ROOMS[form][2])).to_have_value("half@a.sentence")


@pytest.mark.parametrize("form", ["note"])
def test_another_person_does_not_find_it(real, page, form):
    begun(page, form)
    address = page.url
    end_the_session(page)
    sign_in(page, real.link("Charles Babbage", role="admin"), address)
    expect(page.get_by_label(ROOMS[form][2])).to_have_value("")
    assert "half@a.sentence" not in page.evaluate("JSON.stringify({ ...sessionStorage, ...localStorage })")


@pytest.mark.parametrize("form", ["note", "invitation"])
def test_another_language_loses_nothing(page, form):
    begun(page, form)
    page.locator("button.language").click()
    expect(page.locator("html")).to_have_attribute("lang", "fi")
    expect(page.get_by_label("Merkintä" if form == "note" else "Nimi")).to_have_value("half@a.sentence")
    expect(page.get_by_role("link", name="Hälytykset")).to_be_visible()
