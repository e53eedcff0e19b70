"""What a commissioning found, on a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from edge_agent.commissioning.offline import Calibrated


def show(found: Calibrated, console: Console | None = None) -> None:
    """Warnings, bias by anchor, uncertainty, and the go/no-go."""
    console = console or Console(highlight=False)
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
    worth = (1 - found.fit.spread.correlation) / (1 + found.fit.spread.correlation)
    console.print(
        f"Noise {found.fit.spread.range_sigma_m * 1000:.0f} mm; a round is worth {worth:.2f} independent ones; "
        f"bias common to all anchors ±{found.fit.installation_m * 1000:.0f} mm."
    )
    for note in found.notes:
        console.print(f"[yellow]![/yellow] {escape(note.text)}")
    console.print("\n[bold]What this pad can verify[/bold] (honest drone; distances from the anchors' middle)")
    for item in found.reaches:
        mark = "[green]go[/green]   " if item.everywhere_m is not None else "[red]no-go[/red]"
        console.print(f"  {mark} {item.sentence()}")
    for distance, rounds in found.by_distance:
        if rounds > 0:
            sentence = f"At {distance:g} m it can verify ±{found.map.buffer_m:g} m with {rounds} rounds."
            console.print(f"  [dim]{sentence}[/dim]")
