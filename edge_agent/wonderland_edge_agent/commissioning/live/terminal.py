"""The dialogue with an operator at a terminal; without one (``--yes``) it never waits."""

from __future__ import annotations

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.prompt import Confirm
from rich.table import Table
from rich.text import Text

from wonderland_edge_agent.commissioning.live.recorder import RunRecorder
from wonderland_edge_agent.commissioning.offline import Calibrated
from wonderland_edge_agent.commissioning.show import show
from wonderland_edge_agent.self_survey import SelfSurvey


class Terminal:
    """``yes``: publish without asking; a survey that its own anchors contradict is then refused."""

    def __init__(self, console: Console, *, yes: bool = False) -> None:
        self._console = console
        self._yes = yes
        self._live: Live | None = None

    def close(self) -> None:
        """End a progress display that is still up."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def step(self, number: int, name: str, text: str) -> None:
        """Print a step's number, name and text."""
        self.close()
        self._console.print(f"\n[bold]{number}. {escape(name)}[/bold] [dim]– {escape(text)}[/dim]")

    def say(self, text: str) -> None:
        """Print a text as it is, without markup."""
        self.close()
        self._console.print(f"   {escape(text)}", soft_wrap=True)

    def warn(self, text: str) -> None:
        """Something to look at."""
        self.close()
        self._console.print(f"   [yellow]![/yellow] {escape(text)}")

    def confirm(self, text: str) -> bool:
        """Whether it may go on."""
        self.close()
        if self._yes:
            return text.startswith("Publish")
        return Confirm.ask(f"   {escape(text)}", console=self._console, default=False)

    def show_check(self, found: SelfSurvey) -> None:
        """The self-survey: who is off, by how much, how certainly."""
        table = Table(box=None, pad_edge=False, show_header=True)
        table.add_column("   anchor")
        for title in ("off by", "1 σ", ""):
            table.add_column(title, justify="right")
        for item in found.anchors:
            bad = found.suspect is not None and item.anchor_id == found.suspect.anchor_id
            mark = "[red]check it[/red]" if bad else "[green]agrees[/green]"
            table.add_row(
                f"   {escape(item.anchor_id)}", f"{item.off_m * 100:.1f} cm", f"{item.sigma_m * 100:.1f} cm", mark
            )
        self._console.print(table)
        if found.exchanged is not None:
            one, other = found.exchanged
            self.warn(f"Anchors {one} and {other} seem to be exchanged: in the survey, or their nodes on the pad.")
        elif found.suspect is not None:
            east, north, up = found.suspect.vector_m
            self.warn(
                f"Anchor {found.suspect.anchor_id} does not stand where the survey has it: by the ranges it is "
                f"{east:+.2f} m east, {north:+.2f} m north, {up:+.2f} m up of there. Survey it again."
            )
        else:
            self.say("Survey and ranges agree.")

    def progress(self, recorder: RunRecorder, seconds: float, reach_m: float, problem: str) -> None:
        """One line, renewed: how long, what was covered, what is missing."""
        found = recorder.coverage
        weakest = min(found.ranges, key=lambda name: found.ranges[name], default="")
        share = found.ranges.get(weakest, 0) / max(found.rounds, 1)
        todo = found.missing(reach_m) or "enough: Ctrl-C ends the run"
        if recorder.position is None:
            todo = "no position of the reference yet"
        if problem:
            todo = f"reference: {problem}"
        line = Text(f"   {seconds:4.0f} s  {found.rounds} rounds  0–{reach_m:g} m [{found.bars(reach_m)}]  ")
        line.append(f"weakest {weakest} {share:.0%}  ", style="dim")
        line.append(todo, style="bold")
        if not self._console.is_terminal:
            return
        if self._live is None:
            self._live = Live(line, console=self._console, auto_refresh=False, transient=False)
            self._live.start()
        self._live.update(line, refresh=True)

    def show_result(self, found: Calibrated) -> None:
        """Print the fit's biases and what the pad can verify with them (go or no-go)."""
        self.close()
        show(found, self._console)
