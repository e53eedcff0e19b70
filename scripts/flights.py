"""Draws what tests/autopilots recorded of real flights.

``scripts/flights.py DIR`` (``WONDERLAND_FLIGHTS=DIR``); ``scripts/flights.py --landings FILE`` (``make landings``).
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from statistics import median
from typing import Any, Final

from wonderland_research.reproduction.style import BUFFER, REFUTED, VERIFIED, save, subplots

IMAGES: Final = Path(__file__).parent.parent / "docs" / "images"
BEFORE_S, AFTER_S, WAY_DOWN_S = 3.0, 20.0, 27.0
BUFFER_M: Final = 1.0


def load(
    folder: Path, name: str, zero: str = "land", after_s: float = AFTER_S
) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Marks, and samples around the landing; seconds since it was ordered, or since another mark."""
    record = json.loads((folder / f"{name}.json").read_text())
    zero_ms = record["marks"][zero]
    marks = {mark: (t_ms - zero_ms) / 1e3 for mark, t_ms in record["marks"].items()}
    samples = [{**sample, "t_s": (sample["t_ms"] - zero_ms) / 1e3} for sample in record["samples"]]
    return marks, [sample for sample in samples if -BEFORE_S <= sample["t_s"] <= after_s]


def draw_way_down(folder: Path, path: Path) -> None:
    """How far from the pad's middle it is on the way down, with its GPS led away from the verdict on."""
    figure, axis = subplots(1, height_in=3.2)
    for name, colour, words in (
        ("precision-none", REFUTED, "by its own position"),
        ("precision-dragged", VERIFIED, "by the ranges"),
    ):
        marks, samples = load(folder, name, "verdict", WAY_DOWN_S)
        times = [sample["t_s"] for sample in samples if sample["t_s"] <= marks["down"]]
        aside = [sample["aside_m"] for sample in samples if sample["t_s"] <= marks["down"]]
        axis.plot(times, aside, color=colour, lw=1.8)
        axis.plot(times[-1:], aside[-1:], "o", color=colour, ms=5)
        axis.annotate(f"{words}: down at {aside[-1]:.1f} m", (times[-1], aside[-1]), (-6, 8), "data", "offset points")
        axis.texts[-1].set(ha="right", color=colour)
    axis.set_title("ArduPilot, GPS led away at 1 m/s from the verdict on")
    axis.set_ylabel("from the pad's middle, m")
    axis.set_xlabel("seconds since the verdict")
    axis.set_xlim(-BEFORE_S, WAY_DOWN_S)
    axis.set_ylim(0, 1.2 * axis.get_ylim()[1])
    save(figure, path)


def draw(folder: Path, path: Path) -> None:
    """Above: how far the autopilot is from where it believes to be. Below: how high it flies."""
    flights = {name: load(folder, name) for name in ("honest", "dragged")}
    figure, (error, height) = subplots(2, height_in=5.0, sharex=True)
    for name, colour in (("honest", VERIFIED), ("dragged", REFUTED)):
        marks, samples = flights[name]
        times = [sample["t_s"] for sample in samples]
        for axis, field in ((error, "off_m"), (height, "height_m")):
            axis.plot(times, [sample[field] for sample in samples], color=colour, lw=1.8)
            axis.axvline(marks["verdict"], color=colour, lw=0.8, ls=":")
    error.axhspan(0, 2 * BUFFER_M, color=BUFFER, alpha=0.2, lw=0)
    error.text(AFTER_S, 2 * BUFFER_M, "two buffers ", ha="right", va="bottom", color=BUFFER)
    flags = {(each["ekf_flags"], each["fix_type"], each["h_acc_mm"]) for each in flights["dragged"][1]}
    unchanged = "its own flags do not change" if len(flags) == 1 else "its flags change"
    error.set_title(f"ArduPilot, GPS dragged away at 1 m/s: {unchanged}")
    error.set_ylabel("error of its position, m")
    height.set_ylabel("height above the pad, m")
    height.set_xlabel("seconds since the order to land")
    height.text(flights["dragged"][0]["verdict"] + 0.4, 6.4, "refuted: held", color=REFUTED)
    height.text(flights["honest"][0]["verdict"] + 3.0, 2.0, "verified: lands", color=VERIFIED)
    error.set_xlim(-BEFORE_S, AFTER_S)
    error.set_ylim(0)
    height.set_ylim(0)
    save(figure, path)


def draw_landings(file: Path, path: Path) -> None:
    """How far from the pad's middle they touched the ground: the share of them that was nearer."""
    landings = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    figure, axis = subplots(1, height_in=3.2)
    farthest = 0.0
    for way, colour, words in (("ranges", VERIFIED, "by the ranges"), ("own", REFUTED, "by its own position")):
        aside = sorted(math.hypot(each["north_m"], each["east_m"]) for each in landings if each["way"] == way)
        count = len(aside)
        middle, most = median(aside), aside[math.ceil(0.95 * count) - 1]
        share = [100 * (index + 1) / count for index in range(count)]
        said = f"{words}, {count} landings: median {middle:.2f} m, 95 % within {most:.2f} m"
        axis.step([0.0, *aside], [0.0, *share], where="post", color=colour, lw=1.8, label=said)
        farthest = max(farthest, aside[-1])
        seconds = median(each["down_s"] for each in landings if each["way"] == way)
        print(f"{said}, the farthest {aside[-1]:.2f} m; down {seconds:.0f} s after the order")
    axis.set_title("ArduPilot in wind of 2 to 8 m/s with gusts, its receiver 1.5 m CEP")
    axis.set_ylabel("% of landings nearer")
    axis.set_xlabel("from the pad's middle at touch-down, m")
    axis.set_xlim(0, 1.05 * farthest)
    axis.set_ylim(0, 100)
    axis.legend(loc="lower right")
    save(figure, path)


def main() -> int:
    """The exit code."""
    if len(sys.argv) == 3 and sys.argv[1] == "--landings":
        draw_landings(Path(sys.argv[2]), IMAGES / "flight-landings.svg")
        return 0
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(sys.argv[1])
    draw(folder, IMAGES / "flight-dragged-gps.svg")
    draw_way_down(folder, IMAGES / "flight-way-down.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
