"""An administrator of a house with a ledger and a backend."""

from __future__ import annotations

import pytest


@pytest.fixture
def admin(house):
    """An administrator who can sign."""
    anna = house.person("Anna", "admin")
    assert anna.enrol("admin", "anna").status_code == 201
    return anna
