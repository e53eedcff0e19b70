"""What the tests of several folders share, a module for each domain."""

from __future__ import annotations

import os
import ssl
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]


def environment():
    """For a process that runs a module of the kit: ``python -m kit.…``."""
    return os.environ | {"PYTHONPATH": str(TESTS)}


PLAIN = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
"""For clients of plain HTTP: to load the authorities of this machine takes a tenth of a test, and none is asked."""
