"""Draws what tests/autopilots recorded of real flights: ``scripts/flights.py DIR`` (``WONDERLAND_FLIGHTS=DIR``)."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Final

from wonderland_research.reproduction.style import BUFFER, REFUTED, VERIFIED, save, subplots

IMAGE: Final = Path(__file__).parent.parent / "docs" / "images" / "flight-dragged-gps.svg"
BEFORE_S, AFTER_S = 3.0, 20.0
BUFFER_M: Final = 1.0


def load(folder: Path, name: str) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Marks, and samples around the landing; seconds since it was ordered."""
    record = json.loads((folder / f"{name}.json").read_text())
    zero_ms = record["marks"]["land"]
    marks = {mark: (t_ms - zero_ms) / 1e3 for mark, t_ms in record["marks"].items()}
    samples = [{**sample, "t_s": (sample["t_ms"] - zero_ms) / 1e3} for sample in record["samples"]]
    return marks, [sample for sample in samples if -BEFORE_S <= sample["t_s"] <= AFTER_S]


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


def main() -> int:
    """The exit code."""
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    draw(Path(sys.argv[1]), IMAGE)
    print(IMAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
