"""An OpenStreetMap extract of a made-up quay."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from town import a_town


@pytest.fixture
def town():
    """A coast with land on its left, a street, three buildings."""
    return a_town()
