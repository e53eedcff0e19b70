"""The backend's fixtures, and receivers of what goes out."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from other_conftest import fixtures_of, tools_of

backend_tests = tools_of("backend")
globals().update(fixtures_of(backend_tests))
