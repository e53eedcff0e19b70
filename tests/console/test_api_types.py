"""The types that the console is checked and built with are those of the backend as it is."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from wonderland_backend.commands import backend

ROOT = Path(__file__).resolve().parents[2]
FRONTEND = ROOT / "frontend"


def test_the_types_are_those_of_the_backend_as_it_is():
    if not (FRONTEND / "node_modules").is_dir():
        pytest.skip("the console's packages are not installed (make setup)")
    subprocess.run([sys.executable, ROOT / "scripts/console.py", "generate"], check=True, timeout=120)
    document = CliRunner().invoke(backend, ["openapi"], catch_exceptions=False).stdout
    now = hashlib.sha256(document.rstrip().encode()).hexdigest()
    first_line = (FRONTEND / "src/shared/api/schema.d.ts").read_text(encoding="utf-8").splitlines()[0]
    written = re.search(r"SHA-256 ([0-9a-f]{64})", first_line)
    assert written is not None, "the first line of schema.d.ts names no document"
    assert written[1] == now, "a change of the backend's interface has not been noticed: see generate-api.mjs"


@pytest.mark.parametrize("task", ["build", "lint", "typecheck"])
def test_what_reads_the_types_makes_them_first(task):
    package = (FRONTEND / "package.json").read_text(encoding="utf-8")
    assert f'"{task}": "node scripts/generate-api.mjs && ' in package
