"""pad.toml and uav.toml, as an operator would write them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

_quoted = json.dumps  # TOML's basic strings are JSON's


def pad_toml(
    pad_id: str,
    connection: Path,
    ports: Mapping[str, Path],
    remote_id: tuple[str, int],
    backend_url: str = "",
    *,
    extra: Sequence[str] = (),
    reports: tuple[str, int] | None = None,
) -> str:
    """A pad's settings.

    ``ports``: its nodes', by anchor. ``backend_url``: http or https. ``extra``: further lines. ``reports``: its boards
    are DWM1001 tags, and drones report there.
    """
    lines = [
        f"pad_id = {_quoted(pad_id)}",
        f"connection = {_quoted(str(connection))}",
        f"identity = {_quoted(pad_id)}",
        'spool = "spool"',
        *extra,
    ]
    for anchor_id, port in ports.items():
        lines += ["", "[[anchors]]", f"anchor_id = {_quoted(anchor_id)}", f"port = {_quoted(str(port))}"]
    if reports is not None:
        lines += ["", "[uwb]", 'kind = "dwm1001-tags"', f"listen = {_quoted(written(reports))}"]
    lines += ["", "[remote_id]", f"listen = {_quoted(written(remote_id))}"]
    if backend_url:
        lines += ["", "[backend]", f"url = {_quoted(_ingest(backend_url))}"]
        if backend_url.startswith("http:"):
            lines.append("plaintext = true")
    return "\n".join(lines) + "\n"


def uav_toml(
    uav_id: str,
    connection: Path,
    port: Path,
    position: str,
    pads: Sequence[str],
    backend_url: str = "",
    *,
    board: int | None = None,
    reports: tuple[str, int] | None = None,
    extra: Sequence[str] = (),
) -> str:
    """A drone's settings.

    ``position``: as the option. ``board``, ``reports``: it has a DWM1001 of this address, and its pad listens there.
    ``extra``: further lines, at the end.
    """
    lines = [
        f"connection = {_quoted(str(connection))}",
        f"identity = {_quoted(uav_id)}",
        f"port = {_quoted(str(port))}",
        f"position = {_quoted(position)}",
        f"pads = {_quoted(list(pads))}",
    ]
    if board is not None and reports is not None:
        lines += ['node = "dwm1001-anchor"', f'board = "{board:04x}"', f"report_to = {_quoted(written(reports))}"]
    if backend_url:
        lines.append(f"backend = {_quoted(_ingest(backend_url))}")
    return "\n".join([*lines, *extra]) + "\n"


def by_permission(geoid: Path, memory: Path) -> list[str]:
    """Lines of a ``uav.toml`` whose drone's autopilot is held until the ledger permits the landing."""
    return [f"geoid = {_quoted(str(geoid))}", "", "[flight]", f"memory = {_quoted(str(memory))}"]


def written(address: tuple[str, int]) -> str:
    """As ``host:port``."""
    return f"{address[0]}:{address[1]}"


def _ingest(url: str) -> str:
    return url.replace("http", "ws", 1).rstrip("/") + "/ingest"
