"""Ready files: a pad.toml for each pad, a uav.toml for each vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from wonderland_simulator.configs import pad_toml, uav_toml
from wonderland_simulator.practice.reading import Scenario


def write_files(scenario: Scenario, to: Path, connection: Path, backend_url: str) -> Iterator[tuple[Path, bool]]:
    """Each file, and whether it was written: one that is there and says something else is the user's, and stays.

    Raises OSError.
    """
    for pad in scenario.pads:
        text = pad_toml(pad.told.pad_id, connection, pad.ports, pad.remote_id, backend_url, reports=pad.reports)
        yield _write(to / pad.told.pad_id / "pad.toml", text)
    reports = {pad.told.pad_id: pad.reports for pad in scenario.pads}
    for each in scenario.vehicles:
        if each.position is None:
            continue
        text = uav_toml(
            each.told.uav_id,
            connection,
            each.port,
            each.position,
            [each.told.pad],
            backend_url,
            board=each.board,
            reports=reports[each.told.pad],
        )
        yield _write(to / each.told.uav_id / "uav.toml", text)


def _write(path: Path, text: str) -> tuple[Path, bool]:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    if path.exists() and path.read_text(encoding="utf-8") != text:
        return path, False
    path.write_text(text, encoding="utf-8")
    return path, True
