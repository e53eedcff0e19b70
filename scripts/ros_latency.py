"""Draw how long a ROS message takes over the ledger: ``scripts/ros_latency.py FILE`` (``make ros-latency``)."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Final

from wonderland_research.reproduction.style import QUIET, SERIES, save, subplots

IMAGE: Final = Path(__file__).parent.parent / "docs" / "images" / "ros-latency.svg"


def draw(file: Path, path: Path) -> None:
    """Of each ledger the share of messages that were back within a time, and of bare commits that were valid."""
    figure, axis = subplots(height_in=3.2)
    longest = 0.0
    for colour, line in zip(SERIES, file.read_text(encoding="utf-8").splitlines(), strict=False):
        run = json.loads(line)
        for name, style, weight in (("bare_ms", ":", 1.2), ("whole_ms", "-", 1.8)):
            times = sorted(run[name])
            share = [100 * (index + 1) / len(times) for index in range(len(times))]
            label = run["what"] if name == "whole_ms" else None
            axis.step(times, share, where="post", color=colour, ls=style, lw=weight, label=label)
            longest = max(longest, times[int(0.98 * len(times))])
    axis.plot([], [], color=QUIET, ls=":", label="dotted: a bare commit of the same ledger")
    axis.set_title("Topic → signed, endorsed, ordered, VALID in a block → topic")
    axis.set_xlabel("ms")
    axis.set_ylabel("% within")
    axis.set_xlim(0, longest * 1.1)
    axis.set_ylim(0, 100)
    axis.grid(visible=True)
    figure.legend(loc="outside lower center", ncols=2)
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
