"""The same ledger and contract as in tests/ledger_embedded."""

import importlib.util
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))
_path = Path(__file__).parent.parent / "ledger_embedded" / "conftest.py"
_spec = importlib.util.spec_from_file_location("embedded_conftest", _path)
_helpers = importlib.util.module_from_spec(_spec)
sys.modules["embedded_conftest"] = _helpers
_spec.loader.exec_module(_helpers)


@pytest.fixture(name="open_world", scope="session")
def _open_world():
    yield _helpers.open_world
    _helpers.TEMPLATE.cleanup()


@pytest.fixture
async def world(tmp_path, open_world):
    async with open_world(tmp_path / "ledger") as running:
        yield running
