"""The console's Finnish reasons are the backend's: a stale copy fails."""

from __future__ import annotations

import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_consoles_reasons_are_the_backends():
    path = ROOT / "scripts" / "finnish_reasons.py"
    specification = importlib.util.spec_from_file_location("finnish_reasons", path)
    script = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(script)
    assert script.TARGET.read_text("utf-8") == script.text(), "stale: run `make api`"
