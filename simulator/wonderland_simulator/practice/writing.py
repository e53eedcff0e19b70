"""Ready files: a pad.toml for each pad, a uav.toml for each vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from wonderland.geoid import COLUMNS, ROWS
from wonderland_simulator.configs import by_permission, pad_toml, uav_toml
from wonderland_simulator.practice.reading import Scenario

GEOID: Final = "practice-geoid.dac"
SEA_LEVEL: Final = bytes(2 * ROWS * COLUMNS)
"""In a practice world the sea lies on the ellipsoid, for autopilots in simulation know no geoid."""


def write_files(scenario: Scenario, to: Path, connection: Path, backend_url: str) -> Iterator[tuple[Path, bool]]:
    """Each file, and whether it was written: one that is there and says something else is the user's, and stays.

    Raises OSError.
    """
    for pad in scenario.pads:
        text = pad_toml(pad.told.pad_id, connection, pad.ports, pad.remote_id, backend_url, reports=pad.reports)
        yield _write(to / pad.told.pad_id / "pad.toml", text.encode())
    reports = {pad.told.pad_id: pad.reports for pad in scenario.pads}
    for each in scenario.vehicles:
        if each.position is None:
            continue
        here = to / each.told.uav_id
        flown: list[str] = []
        if each.told.autopilot is not None:
            geoid = here / GEOID
            yield _write(geoid, SEA_LEVEL)
            flown = by_permission(geoid, here / "flight.json")
        text = uav_toml(
            each.told.uav_id,
            connection,
            each.port,
            each.position_option,
            [each.told.pad],
            backend_url,
            board=each.board,
            reports=reports[each.told.pad],
            extra=flown,
        )
        yield _write(here / "uav.toml", text.encode())


def _write(path: Path, content: bytes) -> tuple[Path, bool]:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    if path.exists() and path.read_bytes() != content:
        return path, False
    path.write_bytes(content)
    return path, True
