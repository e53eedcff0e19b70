"""The administrator's page of machines, in Chromium on a real backend: a secret shown once, rights in words, the end."""

from __future__ import annotations

import re

import httpx
import pytest
from playwright.sync_api import expect

from wonderland import messages
from wonderland_backend.clients.scopes import SCOPES


def token(url, client_id, secret):
    return httpx.post(
        f"{url}/oauth/token", data={"grant_type": "client_credentials"}, auth=(client_id, secret), trust_env=False
    )


def test_a_machine_from_its_secret_to_its_end(real_backend, open_page):
    real = real_backend(demo=True)  # at an address that can have no passkeys
    page = open_page(real.link("A. Admin", "admin"), room="people")
    page.get_by_role("link", name="Machines").click()
    expect(page.get_by_text("No machine is registered.")).to_be_visible()
    page.get_by_role("button", name="Register a machine").click()
    page.get_by_label("Name").fill("City traffic <b>room</b>")
    page.get_by_role("checkbox", name="Landing pads and their health").check()
    page.get_by_role("button", name="Register a machine").click()
    secret = page.get_by_test_id("client-secret").text_content()
    client_id = page.get_by_text(re.compile("^wl-[0-9a-f]{24}$")).text_content()
    assert token(real.url, client_id, secret).status_code == 200
    page.get_by_role("button", name="I have it").click()
    row = page.get_by_role("row").filter(has_text="City traffic <b>room</b>")
    expect(row).to_contain_text("Proofs, sessions and verdicts")
    expect(row).to_contain_text("no personal data")
    assert secret not in page.content()

    row.get_by_role("button", name="New secret…").click()
    expect(page.get_by_text("This registers a successor of City traffic")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Landing pads and their health")).to_be_checked()
    page.get_by_role("button", name="Register a machine").click()
    expect(page.get_by_test_id("client-secret")).not_to_have_text(secret)
    page.get_by_role("button", name="I have it").click()
    expect(row).to_have_count(2)

    old = row.filter(has_text=client_id)
    old.get_by_role("button", name="Disable…").click()
    old.get_by_role("button", name=re.compile("Disable for good")).click()
    expect(old).to_contain_text("disabled")
    assert token(real.url, client_id, secret).status_code == 401
    page.get_by_role("link", name="Audit log").click()
    expect(
        page.get_by_role("row").filter(has_text="A. Admin").filter(has_text="City traffic <b>room</b>")
    ).to_have_count(2)
    expect(
        page.get_by_role("row").filter(has_text="disabled a machine").filter(has_text=f"client/{client_id[:4]}")
    ).to_have_count(1)


def test_others_see_nothing_of_it(real, open_page):
    page = open_page(real.link("I. Inspector", "inspector"), room="people")
    expect(page.get_by_role("link", name="People")).to_be_visible()
    page.evaluate("location.hash = '#/people/clients'")
    expect(page.get_by_role("heading", name="Passkeys")).to_be_visible()
    expect(page.get_by_role("link", name="Machines")).to_have_count(0)
    assert page.evaluate("fetch('/api/v1/clients').then((answer) => answer.status)") == 403
    page.watched.expected = ("403",)


@pytest.mark.parametrize("language", messages.LANGUAGES)
@pytest.mark.parametrize("scope", SCOPES)
def test_every_scope_has_its_words_in_every_language(scope, language):
    assert messages.text("console/client", "scope", {"scope": re.sub("[.-]", "_", scope)}, language)
