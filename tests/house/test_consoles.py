"""What commands print for people: on a terminal as wide as that, in a pipe as wide as it wants to be."""

from __future__ import annotations

import subprocess
import sys

TABLE = """
from rich.table import Table
from wonderland.consoles import for_people
table = Table(*("column %d" % number for number in range(40)))
table.add_row(*("verified" for _ in range(40)))
for_people().print(table)
"""


def test_a_table_in_a_pipe_is_not_cut_off():
    printed = subprocess.run([sys.executable, "-c", TABLE], capture_output=True, text=True, check=True, timeout=60)
    assert printed.stdout.count("verified") == 40
    assert "column 39" in printed.stdout
    assert "…" not in printed.stdout
