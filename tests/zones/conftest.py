"""Houses with a ledger and a backend: those of the registry's tests."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from other_conftest import fixtures_of, tools_of

registry_tests = tools_of("registry")
globals().update(fixtures_of(registry_tests))

FILES = Path(__file__).parent / "files"


@pytest.fixture
def admin(house):
    """An administrator who can sign."""
    anna = house.person("Anna", "admin")
    assert anna.enrol("admin", "anna").status_code == 201
    return anna


def pytest_collection_modifyitems(items):
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
