"""Ranges of boards at a bench, as a recording: rows of ``t``, ``anchor``, ``range`` that ``pad commission`` reads.

Either one board on the drone measures its range to each of the pad's (``anchors``: names by address), or each of the
pad's measures its own to the one on the drone (``boards``: one port for each name).
"""

from __future__ import annotations

import asyncio
import contextlib
import csv
from collections.abc import AsyncGenerator, Mapping
from pathlib import Path
from typing import Any, Final

from wonderland_fira_uci.errors import NodeError

HEADER: Final = ("t", "anchor", "range", "nlos")
Reports = AsyncGenerator[dict[str, Any], None]


class Recorder:
    """Writes ranges as they come, line by line, so that a power cut costs none but the last."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("x", newline="", encoding="utf-8", buffering=1)
        except FileExistsError:
            raise NodeError(f"{path}: is there already; a recording is not overwritten") from None
        except OSError as error:
            raise NodeError(f"{path}: cannot be written ({error.strerror or error})") from error
        self._writer = csv.writer(self._file)
        self._writer.writerow(HEADER)
        self.rows: dict[str, int] = {}
        self.damaged = 0
        self._t_ms = 0
        self._latest_ms: dict[str, int] = {}

    def write(self, document: Mapping[str, Any], names: Mapping[str, str]) -> None:
        """A report; ``names``: under which name the range to which address is written. Others are left out."""
        if document["kind"] != "ranges":
            return
        if document.get("damaged"):
            self.damaged += 1
            return
        self._t_ms = max(self._t_ms, int(document["t_ms"]))  # boards are read one after the other; times do not fall
        for row in document["ranges"]:
            name = names.get(row["address"])
            if name is not None and row.get("range_mm") is not None:
                # Reports that a port handed over at once bear one time; an anchor has one range at a time.
                self._t_ms = self._latest_ms[name] = max(self._t_ms, self._latest_ms.get(name, -1) + 1)
                nlos = int(bool(row.get("obstructed")))
                self._writer.writerow((f"{self._t_ms / 1000:.3f}", name, f"{row['range_mm'] / 1000:.3f}", nlos))
                self.rows[name] = self.rows.get(name, 0) + 1

    def close(self) -> None:
        """Done. A recording without a range is none: it goes, so that the next try is not refused for it."""
        self._file.close()
        if not self.rows:
            self._path.unlink(missing_ok=True)


async def record(
    sources: Mapping[str, tuple[Reports, Mapping[str, str]]], recorder: Recorder, seconds: float | None
) -> None:
    """Until ``seconds`` are over, or until it is cancelled. Raises UwbError where a board does not report."""

    async def read(reports: Reports, names: Mapping[str, str]) -> None:
        async with contextlib.aclosing(reports):
            async for document in reports:
                recorder.write(document, names)

    tasks = [asyncio.create_task(read(*source)) for source in sources.values()]
    try:
        done, _ = await asyncio.wait(tasks, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        recorder.close()
