"""One session on each ledger, exported once."""

from __future__ import annotations

import contextlib
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from kit.evidence import exhibit
from kit.forgers import signing
from kit.scenario_world import PLACES
from playwright.sync_api import expect

from wonderland_fabric_gateway.ca import LocalCa
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_network import binaries
from wonderland_fabric_network.errors import BinaryError

PAGE = Path(__file__).parents[2] / "docs" / "evidence-verifier.html"
DONE = re.compile(r"hold|read")


@pytest.fixture(scope="session")
def aside():
    """``aside(work, …)`` in a thread of its own: where a browser is open, this one has an event loop already."""

    def aside(work, *arguments):
        with ThreadPoolExecutor(1) as threads:
            return threads.submit(work, *arguments).result()

    return aside


@pytest.fixture(scope="session")
def exhibits(tmp_path_factory, aside):
    """Makes the exhibit of a kind of ledger when it is first asked for; the ledgers run to the end."""
    made = {}
    with contextlib.ExitStack() as endings:

        def of(kind):
            if kind not in made:
                place = PLACES[kind](tmp_path_factory.mktemp(kind))
                endings.callback(aside, place.stop)
                aside(place.start)
                made[kind] = aside(exhibit, place, tmp_path_factory.mktemp(f"{kind}-evidence"))
            return made[kind]

        yield of


@pytest.fixture(scope="session", params=[pytest.param("embedded"), pytest.param("fabric", marks=pytest.mark.fabric)])
def shown(request, exhibits):
    """The evidence of a session, of each ledger in turn."""
    if request.param == "fabric":
        try:
            binaries.find_binaries()
        except BinaryError as error:
            pytest.skip(f"Fabric's servers are needed: {error}")
    return exhibits(request.param)


@pytest.fixture(scope="session")
def small(exhibits):
    """That of the embedded ledger, for what need not be tried on both."""
    return exhibits("embedded")


@pytest.fixture
def shown_in(browser):
    """What the page says of two files: its statuses, and its line on top. It may ask nobody for anything."""
    context = browser.new_context()
    page = context.new_page()
    asked, errors = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(PAGE.as_uri())

    def of(evidence, trust):
        page.get_by_label("Trust file", exact=True).set_input_files([])
        expect(page.get_by_role("status")).to_have_text("")
        for name, data in (("Evidence", evidence), ("Trust file", trust)):
            page.get_by_label(name, exact=True).set_input_files(
                {"name": "x.json", "mimeType": "application/json", "buffer": data}
            )
        expect(page.get_by_role("status")).to_have_text(DONE, timeout=30_000)
        statuses = [each.get_attribute("data-status") for each in page.get_by_role("listitem").all()]
        return statuses, page.get_by_role("status").inner_text()

    yield of
    assert asked == [PAGE.as_uri()]
    assert not errors
    context.close()


@pytest.fixture(scope="session")
def thief(tmp_path_factory):
    """An orderer's certificate in the organisation's name, from a CA of the forger's own."""
    directory = tmp_path_factory.mktemp("forger")
    ca = LocalCa.create(directory / "ca", "OrdererMSP")
    return signing("OrdererMSP", *ca.enrol("orderer0", node_ou="orderer").write(directory))


@pytest.fixture(scope="session")
def inside(shown):
    """The key of the real orderer."""
    if shown.kind == "embedded":
        stem = shown.place.directory / "node" / "orderer-OrdererMSP"
        return signing("OrdererMSP", stem.with_suffix(".pem"), stem.with_suffix(".key"))
    msp = shown.place.directory.path / "organisations" / "OrdererMSP" / "nodes" / "orderer0" / "msp"
    (certificate,), (key,) = (msp / "signcerts").iterdir(), (msp / "keystore").iterdir()
    return signing("OrdererMSP", certificate, key)


@pytest.fixture(scope="session")
def pad(shown):
    """The key of the session's pad."""
    return Connection.load(shown.place.connection_file).signer("pad-e1")
