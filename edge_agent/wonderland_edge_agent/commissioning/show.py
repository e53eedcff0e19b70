"""What a commissioning found, on a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from wonderland.consoles import for_people
from wonderland_edge_agent.commissioning.clocks import Clocks
from wonderland_edge_agent.commissioning.offline import Calibrated
from wonderland_edge_agent.commissioning.reach import SHARE


def show(found: Calibrated, console: Console | None = None) -> None:
    """Warnings, bias by anchor, uncertainty, and the go/no-go."""
    console = console or for_people()
    facts = found.fit.document()
    coverage = found.fit.coverage
    console.print(
        f"[bold]{coverage.seconds} s[/bold] of ranges with truth, {coverage.nearest_m:.1f} to "
        f"{coverage.furthest_m:.1f} m. Median error {facts['uncalibrated_error_m'] * 100:.1f} cm before, "
        f"{facts['held_out_error_m'] * 100:.1f} cm after, on parts that the fit did not see."
    )
    table = Table(box=None, pad_edge=False)
    table.add_column("anchor")
    for title in ("bias near", "in the middle", "far", "uncertain by", "bursts"):
        table.add_column(title, justify="right")
    for index, name in enumerate(found.fit.anchor_ids):
        bias = found.fit.curves.bias_m[index] * 1000
        sigma = found.fit.spread.bias_sigma_m[index] * 1000
        table.add_row(
            escape(name),
            *(f"{value:+.0f} mm" for value in (bias[0], bias[len(bias) // 2], bias[-1])),
            f"{min(sigma):.0f} to {max(sigma):.0f} mm",
            f"{found.fit.outliers[name]:.1%}",
        )
    console.print(table)
    if found.choice is not None and found.choice.judged:
        console.print(found.choice.sentence())
    console.print(f"[dim]{found.fit.truth.sentence()}[/dim]")
    worth = (1 - found.fit.spread.correlation) / (1 + found.fit.spread.correlation)
    console.print(
        f"Noise {found.fit.spread.range_sigma_m * 1000:.0f} mm; a round is worth {worth:.2f} independent ones; "
        f"bias common to all anchors ±{found.fit.installation_m * 1000:.0f} mm."
    )
    if found.clocks is not None:
        _show_clocks(found.clocks, console)
    for note in found.notes:
        console.print(f"[yellow]![/yellow] {escape(note.text)}")
    console.print(f"\n[bold]What this pad can verify[/bold] (go: {SHARE}; distances from the anchors' middle)")
    for item in found.reaches:
        mark = "[green]go[/green]   " if item.everywhere_m is not None else "[red]no-go[/red]"
        console.print(f"  {mark} {item.sentence()}")
    for at in found.by_distance:
        console.print(f"  [dim]{at.sentence()}[/dim]")
    if not found.go:
        console.print(f"[red]No-go[/red]: ±{found.map.buffer_m:g} m is verified at no distance in every direction.")
    if any(item.best_m is not None for item in found.height_reaches):
        console.print(f"\n[bold]Heights[/bold] (proved within; {found.map.height_m:g} m above the pad)")
        for item in found.height_reaches:
            console.print(f"  [dim]{item.sentence()}[/dim]")
    else:
        console.print("\n[bold]Heights[/bold] stay the drone's word: these anchors do not tell them.")
    if found.timed_reaches:
        console.print("\n[bold]At assurance 3[/bold] (time stamps alone)")
        for item in found.timed_reaches:
            mark = "[green]go[/green]   " if item.everywhere_m is not None else "[red]no-go[/red]"
            console.print(f"  {mark} {item.sentence('frame')}")
    elif found.clocks is not None:
        console.print("\n[bold]At assurance 3[/bold] [red]no-go[/red]: see the clocks above.")


def _show_clocks(clocks: Clocks, console: Console) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("clock of", "late by", "uncertain by"):
        table.add_column(title, justify="left" if title == "clock of" else "right")
    for name, offset, sigma in zip(clocks.anchor_ids, clocks.offset_m, clocks.sigma_m, strict=True):
        table.add_row(escape(name), f"{offset * 1000:+.0f} mm", f"{sigma * 1000:.0f} mm")
    console.print(table)
    console.print(f"Noise of one time stamp {clocks.stamp_sigma_m * 1000:.0f} mm, from {clocks.frames} blinks.")
