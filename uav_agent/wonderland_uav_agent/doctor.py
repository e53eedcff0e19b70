"""What `wonderland doctor` checks of a drone's agent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from wonderland.doctor import gather
from wonderland.doctor.checks import Check
from wonderland.toml_settings import SettingsError
from wonderland_uav_agent.settings import load

PART = "uav"


def checks(path: Path, now_ms: int) -> Iterator[Check]:
    """Of the drone whose settings these are; what only the command line says is not known here."""
    try:
        settings = load(path)
    except SettingsError as error:
        yield Check(PART, "settings", "failed", str(error), f"wonderland uav serve --check --config {path}")
        return
    yield Check(PART, "settings", "ok", f"they can be read: {path}")
    if settings.connection is not None:
        yield from gather.ledger(PART, settings.connection, settings.identity or "uav", now_ms)
    if settings.port is not None:
        yield gather.port(PART, settings.port)
