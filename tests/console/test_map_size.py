"""What a browser fetches before the live map can be used."""

from __future__ import annotations

import gzip
import re

LIMIT = 650_000
REFERENCE = re.compile(r"""(?:from|import)\s*["']\./([\w.-]+\.m?js)["']""")


def test_the_scripts_of_the_map_stay_small(built_console):
    """All that the first page loads at once, both workers included, as a server sends it."""
    assets = built_console / "assets"
    page = (built_console / "index.html").read_text()
    waiting = set(re.findall(r"/assets/([\w.-]+\.m?js)", page))
    assert waiting
    waiting |= {file.name for file in assets.glob("*worker*js")}
    known = set()
    while waiting:
        name = waiting.pop()
        known.add(name)
        waiting |= set(REFERENCE.findall((assets / name).read_text())) - known
    assert any("worker" in name for name in known)
    sizes = {name: len(gzip.compress((assets / name).read_bytes())) for name in known}
    assert sum(sizes.values()) <= LIMIT, sizes
