"""What was found, as the tables of docs/protocol.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from wonderland_research.protocol.model import LEVELS, Scenario
from wonderland_research.protocol.prover import Outcome, Run

BEGIN: Final = "<!-- lemmas: made by wonderland protocol --write -->"
END: Final = "<!-- /lemmas -->"
_BOLD: Final[frozenset[Outcome]] = frozenset(("attack", "not proved", "never reached"))


def markdown(runs: Iterable[Run]) -> str:
    """A table for each scenario, its lemmas by level."""
    by_scenario: dict[str, list[Run]] = {}
    for run in runs:
        by_scenario.setdefault(run.scenario.name, []).append(run)
    tables = (_table(found[0].scenario, {run.level: run.outcomes for run in found}) for found in by_scenario.values())
    return "\n\n".join(tables)


def _table(scenario: Scenario, found: Mapping[int | None, Mapping[str, Outcome]]) -> str:
    columns: list[tuple[int | None, str]] = [(level, str(level)) for level in LEVELS if level in found]
    columns += [(None, "Found")] if None in found else []
    lines = [
        f"**`{scenario.name}`.** {scenario.says}",
        "",
        "| Lemma | What it says | " + " | ".join(name for _, name in columns) + " |",
        "|---" * (2 + len(columns)) + "|",
    ]
    for lemma in scenario.lemmas:
        cells = " | ".join(_cell(found[level][lemma.name]) for level, _ in columns if lemma.name in found[level])
        lines.append(f"| `{lemma.name}` | {lemma.says} | {cells} |")
    return "\n".join(lines)


def _cell(outcome: Outcome) -> str:
    return f"**{outcome}**" if outcome in _BOLD else outcome


def tables_of(page: str) -> str:
    """What a page has between the marks. Raises ValueError without them."""
    _, begin, rest = page.partition(BEGIN)
    inside, end, _ = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no lines {BEGIN!r} and {END!r}")
    return inside.strip()


def with_tables(page: str, tables: str) -> str:
    """The page with these tables between the marks. Raises ValueError without them."""
    tables_of(page)
    before, _, rest = page.partition(BEGIN)
    after = rest.partition(END)[2]
    return f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}"


def rows_of(tables: str) -> dict[str, tuple[str, ...]]:
    """Lemma → its cells, of tables as ``markdown`` makes them."""
    rows = {}
    for line in tables.splitlines():
        if line.startswith("| `"):
            name, _, *cells = (cell.strip() for cell in line.strip("|").split("|"))
            rows[name.strip("`")] = tuple(cell.strip("*") for cell in cells)
    return rows
