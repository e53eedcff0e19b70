"""Project Wycheproof's test vectors, which are fetched and not committed: C2SP/wycheproof, in a directory of their own."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

VARIABLE = "WYCHEPROOF_DIR"


def groups(name: str) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Each group of a file, with its tests; skips where there are no vectors."""
    found = os.environ.get(VARIABLE)
    if not found:
        pytest.skip(f"{VARIABLE} names no directory: clone C2SP/wycheproof there")
    path = Path(found) / "testvectors_v1" / f"{name}.json"
    for group in json.loads(path.read_text())["testGroups"]:
        yield group, group["tests"]
