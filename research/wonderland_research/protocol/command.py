"""The command ``wonderland protocol``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from wonderland_research.protocol import report
from wonderland_research.protocol.model import LEVELS, Scenario, scenarios
from wonderland_research.protocol.prover import ProverError, Run, binary, prove_all


@click.command()
@click.option("--lemma", "lemmas", multiple=True, metavar="NAME", help="Only this one; may be repeated.")
@click.option("--level", "levels", multiple=True, type=click.IntRange(0, 4), metavar="0..4", help="Only this level.")
@click.option("--trace", is_flag=True, help="ProVerif's own words as well: each attack step by step.")
@click.option(
    "--page",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Compare with the tables of this page (docs/protocol.md); 1 where they differ.",
)
@click.option("--write", is_flag=True, help="With --page: put the tables there.")
@click.option("--processes", type=click.IntRange(1, 256), help="As many as cores unless given.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")
def protocol(
    *,
    lemmas: tuple[str, ...],
    levels: tuple[int, ...],
    trace: bool,
    page: Path | None,
    write: bool,
    processes: int | None,
    as_json: bool,
) -> None:
    """Prove what the exchange promises, and find the attacks that each level of assurance leaves (minutes).

    \b
    PROVERIF_BIN names ProVerif's program; docs/protocol.md says how to build it, and what the lemmas mean.
      PROVERIF_BIN=… wonderland protocol
      PROVERIF_BIN=… wonderland protocol --lemma place_uav --level 2 --trace
    """  # noqa: D301 - click's own mark
    if page is not None and (lemmas or levels):
        raise click.UsageError("--page has all tables: leave --lemma and --level out")
    if write and page is None:
        raise click.UsageError("--write needs --page")
    asked = _asked(frozenset(lemmas), levels or LEVELS)
    runs = _proved(asked, processes, quiet=as_json)
    if trace:
        for run in runs:
            click.echo(run.output)
    if as_json:
        click.echo(json.dumps([_plain(run) for run in runs]))
    else:
        click.echo(report.markdown(runs))
    if page is not None:
        _hold_against(page, report.markdown(runs), write=write)


def _asked(lemmas: frozenset[str], levels: tuple[int, ...]) -> list[tuple[Scenario, int | None]]:
    found = scenarios()
    unknown = lemmas - {lemma.name for scenario in found for lemma in scenario.lemmas}
    if unknown:
        raise click.UsageError(f"--lemma: there is no {', '.join(sorted(unknown))}")
    chosen = [scenario.only(lemmas) if lemmas else scenario for scenario in found]
    return [
        (scenario, level)
        for scenario in chosen
        if scenario.lemmas
        for level in ([level for level in scenario.levels if level in levels] if scenario.levels else [None])
    ]


def _proved(asked: list[tuple[Scenario, int | None]], processes: int | None, *, quiet: bool) -> list[Run]:
    def told(run: Run) -> None:
        if not quiet:
            click.echo(f"{run.scenario.name}{'' if run.level is None else f' at level {run.level}'}", err=True)

    try:
        return prove_all(binary(), asked, told, processes=processes)
    except ProverError as error:
        raise click.ClickException(str(error)) from error


def _plain(run: Run) -> dict[str, object]:
    return {"scenario": run.scenario.name, "level": run.level, "outcomes": run.outcomes}


def _hold_against(page: Path, tables: str, *, write: bool) -> None:
    text = page.read_text(encoding="utf-8")
    try:
        if write:
            page.write_text(report.with_tables(text, tables), encoding="utf-8")
        elif report.tables_of(text) != tables:
            raise click.ClickException(f"{page} says something else: look at what changed, then --write")
    except ValueError as error:
        raise click.ClickException(f"{page}: {error}") from error
