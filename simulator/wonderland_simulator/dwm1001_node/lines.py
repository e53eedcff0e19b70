"""How PANS prints a round in its shell; two decimals, and ``nan`` where it has no position."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from typing import Final

from wonderland_fira_uci.dwm1001.reports import BoardPosition, LocationReport

LE_US: Final = 2576
"""How long the board's solver takes, as in its guide."""


def _metres(value_mm: int | None) -> str:
    return "0.00" if value_mm is None else f"{value_mm / 1000:.2f}"


def _coordinates(position: BoardPosition | None) -> str:
    if position is None:
        return "nan,nan,nan"
    return ",".join(_metres(value) for value in position[:3])


def les(report: LocationReport) -> str:
    """Distances with the anchors' positions, solver time, own estimate."""
    anchors = [
        f"{distance.address:04X}[{_coordinates(distance.position)}]={_metres(distance.range_mm)}"
        for distance in report.distances
    ]
    if report.position is not None:
        anchors.append(f"le_us={LE_US} est[{_coordinates(report.position)},{report.position.quality_percent or 0}]")
    return " ".join(anchors)


def lec(report: LocationReport) -> str:
    """The same as comma-separated values."""
    if not report.distances:
        return ""
    fields = [f"DIST,{len(report.distances)}"]
    for index, distance in enumerate(report.distances):
        fields.append(
            f"AN{index},{distance.address:04X},{_coordinates(distance.position)},{_metres(distance.range_mm)}"
        )
    if report.position is not None:
        fields.append(lep(report))
    return ",".join(fields)


def lep(report: LocationReport) -> str:
    """The own position alone."""
    if report.position is None:
        return "POS,nan,nan,nan,0"
    return f"POS,{_coordinates(report.position)},{report.position.quality_percent or 0}"


def system_information(mode: str, network: int, address: int, rates_tenths: tuple[int, int]) -> bytes:
    """What ``si`` prints, line by line as the firmware's log has it."""
    moving, resting = rates_tenths
    label = f"DW{address:04X}"
    rates = f"upd_rate_norm={moving} upd_rate_stat={resting}"
    told = (
        "sys: fw2 fw_ver=x01030001 cfg_ver=x00010700",
        f"uwb0: panid=x{network:04X} addr=xDECA9AABC0A2{address:04X}",
        f"mode: {mode} (act,{'twr,np,le' if mode == 'tn' else 'real'})",
        "uwbmac: disconnected",
        "uwbmac: bh disconnected",
        f"cfg: sync=0 fwup=0 ble=1 leds=1 le=1 lp=0 stat_det=1 (sens=1) mode=0 {rates} label={label}",
        "enc: off",
        "ble: addr=C2:BB:9E:BE:5D:15",
    )
    return b"".join(f"[{541_880 + index:06d}.000 INF] {line}\r\n".encode() for index, line in enumerate(told))


def spliced(line: str, rng: random.Random) -> str:
    """The line cut anywhere, going on with one of its anchors: what boards send at high rates."""
    starts = [match.start() for match in _ANCHOR.finditer(line)] or [0]
    return line[: rng.randrange(1, len(line) + 1)] + line[rng.choice(starts) :]


_ANCHOR: Final = re.compile(r",AN\d|(?:^| )[0-9A-F]{4}\[")
WRITERS: Final[dict[str, Callable[[LocationReport], str]]] = {"les": les, "lec": lec, "lep": lep}
