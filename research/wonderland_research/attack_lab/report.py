"""What the lab found, for people: tables on the terminal, Markdown for the threat model, plots as SVG."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from wonderland_research.attack_lab.model import AttackResult, LabResult, LevelResult, percent, share

FAMILIES: Final = {
    "baseline": "No attack",
    "position": "On the drone's position",
    "claim": "By words",
    "outsider": "On what is broadcast",
    "radio": "From outside, on the ranging",
    "insider": "The drone's own radio",
    "pad": "On the pad",
    "protocol": "On the protocol and the ledger",
    "collusion": "Collusion",
}


def show(result: LabResult, console: Console) -> None:
    """A table of all attacks on the terminal."""
    table = Table(title="Permissions won", title_justify="left", title_style="bold", box=None, padding=(0, 1, 0, 0))
    for title, justify in (
        ("attack", "left"),
        ("level", "left"),
        ("tries", "right"),
        ("won", "right"),
        ("95 %", "right"),
        ("refuted", "right"),
        ("open", "right"),
        ("found after", "right"),
    ):
        table.add_column(title, justify="right" if justify == "right" else "left", no_wrap=True)
    for attack in result.attacks:
        for levels, one in grouped(attack.levels):
            style = "" if one.as_documented else "bold red"
            table.add_row(
                attack.name,
                span(levels),
                f"{one.tries:,}",
                str(one.won) if one.won else "0",
                f"≤ {percent(one.won_high)}" if not one.won else f"{percent(one.won_low)}–{percent(one.won_high)}",
                share(one.refuted + one.refused, one.tries),
                share(one.open, one.tries),
                found_after(one),
                style=style,
            )
    console.print(table)
    console.print("Levels up to 2 in one row are one simulation, of level 2: the attack goes the same way below.")
    sampled = sum(one.sampled for attack in result.attacks for _, one in grouped(attack.levels))
    asked = sum(one.decisions for attack in result.attacks for _, one in grouped(attack.levels))
    console.print(
        f"\n{result.took_s:.0f} s, seed {result.seed}. The contract's function decided {asked:,} looks itself; of the "
        f"others {sampled:,} were compared with it, none differed."
    )
    if not result.as_documented:
        console.print("[bold red]Attacks in red did not come out as documented.[/bold red]")


def result_from(texts: Sequence[str]) -> LabResult:
    """Runs read back from their ``attacks.json``, as one: of each attack and level, the run with the most tries counts.

    Raises ValueError for a text that is none.
    """
    runs = [_parsed(text) for text in texts]
    attacks: dict[str, AttackResult] = {}
    for one in runs:
        for attack in one.attacks:
            before = attacks.get(attack.name)
            attacks[attack.name] = attack if before is None else _together(before, attack)
    first = runs[0]
    tries = max(one.tries for one in runs)
    return LabResult(first.seed, tries, sum(one.took_s for one in runs), first.versions, tuple(attacks.values()))


def _together(one: AttackResult, other: AttackResult) -> AttackResult:
    levels = {level.level: level for level in one.levels}
    for level in other.levels:
        if level.level not in levels or level.tries > levels[level.level].tries:
            levels[level.level] = level
    # Levels that go the same way were one simulation: the larger run of one of them stands for all.
    return replace(other, levels=tuple(levels[level] for level in sorted(levels)))


def _parsed(text: str) -> LabResult:
    try:
        value = json.loads(text)
        attacks = tuple(
            AttackResult(**{**attack, "levels": tuple(LevelResult(**level) for level in attack["levels"])})
            for attack in value.pop("attacks")
        )
        return LabResult(**value, attacks=attacks)
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"no attacks.json of this version: {error}") from error


def grouped(levels: Sequence[LevelResult]) -> list[tuple[tuple[int, ...], LevelResult]]:
    """Levels at which an attack goes the same way, together."""
    groups: list[tuple[tuple[int, ...], LevelResult]] = []
    for one in levels:
        if groups and _same(groups[-1][1], one):
            groups[-1] = ((*groups[-1][0], one.level), groups[-1][1])
        else:
            groups.append(((one.level,), one))
    return groups


def span(levels: Sequence[int]) -> str:
    """``0–2`` for levels in a row."""
    return str(levels[0]) if len(levels) == 1 else f"{levels[0]}–{levels[-1]}"


def found_after(one: LevelResult) -> str:
    """Ranging time until it was refuted: median, and what 95 % do not exceed."""
    if one.detected_s_median is None or one.detected_s_95 is None:
        return "–"
    if one.detected_s_median == one.detected_s_95:
        return f"{one.detected_s_median:.1f} s"
    return f"{one.detected_s_median:.1f} s ({one.detected_s_95:.1f})"


def markdown(result: LabResult) -> str:
    """The generated part of ``docs/threat-model.md``: a table for each family."""
    lines: list[str] = []
    for family, title in FAMILIES.items():
        attacks = [attack for attack in result.attacks if attack.family == family]
        if not attacks:
            continue
        lines += [
            f"### {title}",
            "",
            "| Attack | The attacker controls; *cost* | Level | Tries | Permissions won | Refuted; open | Found |",
            "|---|---|---|---|---|---|---|",
        ]
        for attack in attacks:
            lines += _rows(attack)
        lines.append("")
    lines.append(
        f"Seed {result.seed}; " + ", ".join(f"{name} {version}" for name, version in result.versions.items()) + "."
    )
    return "\n".join(lines) + "\n"


def _rows(attack: AttackResult) -> list[str]:
    rows = []
    for number, (levels, one) in enumerate(grouped(attack.levels)):
        first = number == 0
        name = f"**{attack.title}** (`{attack.name}`)<br>{attack.stops}" if first else ""
        controls = f"{attack.controls} *{attack.cost}*" if first else ""
        won = "**0**" if not one.won else f"**{share(one.won, one.tries)}**"
        bound = f"≤ {percent(one.won_high)}" if not one.won else f"{percent(one.won_low)}–{percent(one.won_high)}"
        rows.append(
            f"| {name} | {controls} | {span(levels)} | {one.tries:,} | {won} ({bound}) | "
            f"{share(one.refuted + one.refused, one.tries)}; {share(one.open, one.tries)} | {found_after(one)} |"
        )
    return rows


def _same(one: LevelResult, other: LevelResult) -> bool:
    keys = ("tries", "won", "granted", "refuted", "refused", "open", "sampled", "decisions", "detected_s_median")
    return all(getattr(one, key) == getattr(other, key) for key in keys)


def write(result: LabResult, directory: Path) -> list[Path]:
    """``attacks.json``, ``attacks.md`` and the plots; returns what was written."""
    from wonderland_research.attack_lab.plots import draw_detection, draw_permissions  # noqa: PLC0415 - Matplotlib is slow to load

    directory.mkdir(parents=True, exist_ok=True)
    data, table = directory / "attacks.json", directory / "attacks.md"
    data.write_text(json.dumps(result.to_json(), indent=1) + "\n")
    table.write_text(markdown(result))
    plots = [directory / "permissions.svg", directory / "detection.svg"]
    draw_permissions(result, plots[0])
    draw_detection(result, plots[1])
    return [data, table, *plots]
