"""Houses with a ledger and a backend, and the browser of the console's own tests."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

from houses import console_house, house, ledger_template
from other_conftest import tools_of

__all__ = ["console_house", "house", "ledger_template"]

_console = tools_of("console", "wonderland_console_tools")
browser = _console.browser
open_page = _console.open_page
built_console = _console.built_console


def pytest_collection_modifyitems(items):
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
