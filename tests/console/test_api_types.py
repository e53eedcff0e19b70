"""The console's generated types are those of the backend as it is."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from click.testing import CliRunner

from wonderland_backend.commands import backend

SCHEMA = Path(__file__).resolve().parents[2] / "frontend" / "src" / "shared" / "api" / "schema.d.ts"


def test_the_types_are_not_stale():
    document = CliRunner().invoke(backend, ["openapi"], catch_exceptions=False).stdout
    now = hashlib.sha256(document.rstrip().encode()).hexdigest()
    written = re.search(r"SHA-256 ([0-9a-f]{64})", SCHEMA.read_text(encoding="utf-8").splitlines()[0])
    assert written is not None, "the first line of schema.d.ts names no document; run `make api`"
    assert written[1] == now, (
        "the backend's interface has changed: run `make api` and look at what the console makes of it"
    )
