"""What `wonderland doctor` checks of a pad's agent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from wonderland.doctor import gather
from wonderland.doctor.checks import Check
from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.settings import load

PART = "pad"


def checks(path: Path, now_ms: int) -> Iterator[Check]:
    """Of the pad whose settings these are."""
    try:
        settings = load(path)
    except SettingsError as error:
        yield Check(PART, "settings", "failed", str(error), f"wonderland pad run --check --config {path}")
        return
    yield Check(PART, "settings", "ok", f"pad {settings.pad_id}, by {path}")
    yield from gather.ledger(PART, settings.connection, settings.identity, now_ms)
    yield gather.room(PART, settings.spool)
    for anchor in settings.anchors:
        yield gather.port(PART, anchor.port)
