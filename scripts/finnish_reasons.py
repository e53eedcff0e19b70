"""Writes the console's Finnish reasons from the backend's (`make api`): kept once, in `backend/proofs/reasons.py`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from backend.proofs.reasons import FINNISH

TARGET = Path(__file__).resolve().parent.parent / "frontend" / "src" / "sessions" / "finnishReasons.ts"


def text() -> str:
    """The module's text."""
    rows = "".join(f"  {code}: {json.dumps(said, ensure_ascii=False)},\n" for code, said in FINNISH.items())
    return (
        "/** Made by `make api` from backend/proofs/reasons.py; do not edit. */\n"
        f"export const FINNISH_REASONS: Readonly<Record<string, string>> = {{\n{rows}}};\n"
    )


if __name__ == "__main__":
    TARGET.write_text(text(), "utf-8")
    sys.exit(0)
