"""An OpenStreetMap extract of a made-up quay."""

from __future__ import annotations

import pytest
from kit.town import a_town


@pytest.fixture
def town():
    """A coast with land on its left, a street, three buildings."""
    return a_town()
