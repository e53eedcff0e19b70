"""Houses with a ledger and a backend, and the browser of the console's own tests."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

from other_conftest import tools_of
from registry_house import House, new_house

_console = tools_of("console", "wonderland_console_tools")
browser = _console.browser
open_page = _console.open_page
built_console = _console.built_console


@pytest.fixture(scope="session")
def ledger_template(tmp_path_factory):
    """A ledger that has been started once and furnished: certificates and blocks are made a single time."""
    directory = tmp_path_factory.mktemp("template")
    house = House(directory)
    try:
        house.start()
        house.furnish()
    finally:
        house.close()
    return directory


@pytest.fixture
def house(tmp_path, ledger_template):
    running = new_house(tmp_path, ledger_template)
    yield running
    running.close()


@pytest.fixture
def demo_house(tmp_path, ledger_template):
    running = new_house(tmp_path, ledger_template, demo=True)
    yield running
    running.close()


@pytest.fixture
def console_house(tmp_path, ledger_template, built_console):
    """The same with the console, as a demo: keys at a click."""
    running = new_house(tmp_path, ledger_template, console=built_console, demo=True)
    yield running
    running.close()


def pytest_collection_modifyitems(items):
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
