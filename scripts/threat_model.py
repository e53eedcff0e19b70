"""Plays the attack lab and puts its tables and pictures into ``docs/threat-model.md`` (``make threat-model``)."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from wonderland_research.attack_lab import LabResult, LabSettings, run, total_tries
from wonderland_research.attack_lab.attacks import ATTACKS
from wonderland_research.attack_lab.plots import draw_detection, draw_permissions
from wonderland_research.attack_lab.report import markdown, result_from

DOCS = Path(__file__).resolve().parent.parent / "docs"
RESULTS = DOCS / "threat-model.json"
"""The numbers that the tables and pictures are made of."""
CORE = ("<!-- attacks: made by make threat-model -->", "<!-- /attacks -->")
WIRE = ("<!-- wire: made by wonderland attack --wire --report -->", "<!-- /wire -->")


def insert(page: str, table: str, marks: tuple[str, str]) -> str:
    """The page with what stands between the marks replaced; raises ValueError without the marks."""
    before, begin, rest = page.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not begin or not end:
        raise ValueError(f"the page has no lines {marks[0]!r} and {marks[1]!r}")
    return f"{before}{begin}\n\n{table}\n{end}{after}"


def main() -> int:
    """Measure, or take what was measured, and write; 1 where an attack did not come out as documented."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=100_000, help="of each attack (an hour or two on two cores)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="keep what is played here, and go on from it")
    parser.add_argument("--from", dest="found", nargs="*", type=Path, default=[], help="attacks.json of earlier runs")
    parser.add_argument("--add", action="store_true", help="keep of each attack and level what had more tries before")
    parser.add_argument("--wire", type=Path, help="only put in the wire.md of `wonderland attack --wire --report`")
    chosen = parser.parse_args()
    console = Console(stderr=True)
    page = DOCS / "threat-model.md"
    if chosen.wire is not None:
        page.write_text(insert(page.read_text(), chosen.wire.read_text(), WIRE))
        return 0
    if chosen.found:
        texts = [path.read_text() for path in chosen.found]
    else:
        measured = _measure(LabSettings(tries=chosen.tries, seed=chosen.seed, keep=chosen.keep), console)
        texts = [json.dumps(measured.to_json())]
    result = result_from(([RESULTS.read_text()] if chosen.add else []) + texts)
    order = list(ATTACKS)
    # What a class is, is said by the class as it stands, whichever run its numbers are from.
    described = (replace(ATTACKS[each.name].described(), levels=each.levels) for each in result.attacks)
    result = replace(result, attacks=tuple(sorted(described, key=lambda each: order.index(each.name))))
    RESULTS.write_text(json.dumps(result.to_json(), indent=1) + "\n")
    page.write_text(insert(page.read_text(), markdown(result), CORE))
    draw_permissions(result, DOCS / "images" / "attacks-permissions.svg")
    draw_detection(result, DOCS / "images" / "attacks-detection.svg")
    console.print(f"Wrote {page}")
    return 0 if result.as_documented else 1


def _measure(settings: LabSettings, console: Console) -> LabResult:
    left = sum(total_tries(settings).values())
    with console.status("") as status:

        def heard(name: str, tries: int) -> None:
            nonlocal left
            left -= tries
            status.update(f"{name}: {left:,} tries to go")

        return run(settings, heard)


if __name__ == "__main__":
    sys.exit(main())
