"""``wonderland reproduce all``: the evaluation of the verdict as one page."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from wonderland.consoles import for_people
from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland_research.attack_lab.model import LabResult, percent, share
from wonderland_research.attack_lab.plots import draw_permissions
from wonderland_research.attack_lab.report import FAMILIES, found_after, grouped, span
from wonderland_research.attack_lab.run import LabSettings, total_tries
from wonderland_research.attack_lab.run import run as run_lab
from wonderland_research.paper import run_point
from wonderland_research.paper_points import POINTS, PaperRun
from wonderland_research.reproduction import goal_figures, hyu_command, paper_figures
from wonderland_research.reproduction.document import Cell, Document
from wonderland_research.reproduction.goals import Goal, Simulated, simulate
from wonderland_research.reproduction.hyu import HyuResult, measure
from wonderland_research.reproduction.machine import facts
from wonderland_research.reproduction.sampling import wald_rounds
from wonderland_research.reproduction.style import svg

TITLE: Final = "Where is the drone? How often the verdict is right"
LEAD: Final = (
    "A landing pad ranges a drone over ultra-wideband; a contract compares the ranges with what the drone claims. "
    "This report repeats the measurements behind the verdict: its errors, its speed, the paper's experiment, real "
    "recordings and attacks."
)


@dataclass(frozen=True)
class ReportSettings:
    """What the command line asked for."""

    data: Path | None
    out: Path
    tries: int = 20_000
    seed: int = 1
    paper: bool = True
    attacks: bool = True


@dataclass(frozen=True)
class Results:
    """What the report tells of; None where a part was left out."""

    simulated: Simulated
    paper: Sequence[PaperRun] | None = None
    hyu: HyuResult | None = None
    lab: LabResult | None = None


def run(settings: ReportSettings) -> int:
    """Measure, write the page, say where it is; the exit code: 1 where a goal was missed."""
    console = for_people()
    results = measure_all(settings, console)
    document = compose(settings, results)
    settings.out.parent.mkdir(parents=True, exist_ok=True)
    settings.out.write_text(document.html(), encoding="utf-8")
    goals = all_goals(results)
    missed = [goal for goal in goals if goal.met is False]
    for goal in goals:
        mark = {True: "[green]met[/green]", False: "[red]missed[/red]", None: "[dim]–[/dim]"}[goal.met]
        console.print(f"{mark:<22} {goal.what}: {goal.measured} [dim](goal {goal.goal})[/dim]", soft_wrap=True)
    console.print(f"Written: {settings.out} ({settings.out.stat().st_size / 1e6:.1f} MB)")
    return 1 if missed else 0


def measure_all(settings: ReportSettings, console: Console) -> Results:
    """Everything that was asked for, one part after the other. Raises what the parts raise."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:

        def part(name: str) -> Callable[[str, int, int], None]:
            task = progress.add_task(name, total=None)
            return lambda said, done, total: progress.update(task, description=said, completed=done, total=total)

        simulated = simulate(tries=settings.tries, seed=settings.seed, progress=part("Simulating"))
        hyu = None
        if settings.data is not None:
            quick = settings.tries < 2000
            hyu = measure(settings.data, seed=settings.seed, quick=quick, progress=part("Real ranges"))
        lab = _lab(settings, progress) if settings.attacks else None
        paper = asyncio.run(_paper(settings, console, progress)) if settings.paper else None
    return Results(simulated, paper, hyu, lab)


def all_goals(results: Results) -> list[Goal]:
    """Every row of the table of goals."""
    goals = results.simulated.goals()
    if results.hyu is not None:
        goals += hyu_command.goals(results.hyu)
    if results.lab is not None:
        goals += lab_goals(results.lab)
    return goals


def lab_goals(lab: LabResult) -> list[Goal]:
    """Goals that the attack lab measures."""
    command = f"wonderland attack --tries {lab.tries}"
    found = []
    stopped = [
        (attack.name, one)
        for attack in lab.attacks
        for one in attack.levels
        if attack.stopped_from is not None and one.level >= attack.stopped_from
    ]
    insiders = [one for attack in lab.attacks if attack.family == "insider" for one in attack.levels if one.level == 3]
    if insiders:
        won, tries = sum(one.won for one in insiders), sum(one.tries for one in insiders)
        worst = max(one.won_high for one in insiders)
        found.append(
            Goal(
                "Permissions won by the insider with time stamps at level 3",
                "0",
                f"{won} (≤ {percent(worst)} each)",
                f"{tries:,} tries of {len(insiders)} attacks",
                won == 0,
                command,
            )
        )
    drags = [attack for attack in lab.attacks if attack.name == "gnss-drag"]
    for attack in drags:
        farthest = max((one.error_refuted_m_most or 0.0 for one in attack.levels), default=0.0)
        found.append(
            Goal(
                "Slow drag at 1 m/s: error when it is refused",
                "≤ 2 buffers",
                f"at most {farthest:.2f} m",
                f"{sum(one.tries for one in attack.levels):,} tries",
                farthest <= 2.0,
                command,
            )
        )
    bad = [one for name, one in stopped if name.startswith("compromised-anchor")]
    if bad:
        won, tries = sum(one.won for one in bad), sum(one.tries for one in bad)
        found.append(
            Goal(
                "One compromised anchor: lies of 3 buffers and more verified",
                "never",
                f"{won} (≤ {percent(max(one.won_high for one in bad))})",
                f"{tries:,} tries",
                won == 0,
                command,
            )
        )
    return found


def compose(settings: ReportSettings, results: Results) -> Document:
    """Put the results into one page: goals, paper, recordings, attacks, how it was made."""
    document = Document(
        TITLE,
        LEAD,
        facts=[
            ("Repeat", f"`wonderland reproduce all --data DIR --tries {settings.tries} --seed {settings.seed}`"),
            ("Seed", str(settings.seed)),
            *facts(),
        ],
    )
    _goals(document, results)
    _errors(document, results.simulated)
    if results.paper is not None:
        _paper_section(document, results.paper)
    if results.hyu is not None:
        hyu_command.section(document, results.hyu)
    if results.lab is not None:
        _attacks(document, results.lab)
    _limits(document, results)
    return document


def _goals(document: Document, results: Results) -> None:
    document.section("Goals and what was measured")
    document.text(
        "Intervals are 95 % (Clopper and Pearson). Where nothing was seen, the bound is what the sample cannot "
        "exclude. "
        "Errors of the estimate, sessions that cannot settle and the likelihood by the contract's own decision are of "
        "the paper's pad and points: four anchors, 5 cm of noise in each range, a buffer of 1 m; the farther points "
        "are 13 and 14 m away. Error rates and rounds come from draws in one dimension instead, *along the long axis* "
        "of an ellipse (1.8 m after one round, as at the paper's point L1, and others), to which the decision's own "
        "thresholds are applied: no pad stands behind them, and a benchmark holds them against fits of ranges."
    )
    goals = all_goals(results)
    words = {True: Cell("met", "good"), False: Cell("missed", "bad"), None: Cell("–", "none")}
    document.table(
        "Goals. A dash: no threshold, or a sample too small to tell.",
        ["What", "Goal", "Measured", "Sample", ""],
        [[goal.what, goal.goal, goal.measured, goal.sample, words[goal.met]] for goal in goals],
    )
    commands = list(dict.fromkeys(goal.command for goal in goals))
    document.text("Each row by one command: " + "; ".join(f"`{command}`" for command in commands) + ".")


def _errors(document: Document, simulated: Simulated) -> None:
    document.section("Errors under repeated looks")
    document.text(
        "A pad ranges until the session is settled and looks after some rounds whether it is. Who looks until he "
        "likes "
        "what he sees is wrong far more often than each look says. The verdict's limits therefore hold at whichever "
        "round one looks: an outcome needs a mixture of likelihood ratios to exceed 1/α, and by Ville's inequality "
        "that "
        "happens by chance with probability α at most.",
    )
    document.figure(
        svg(goal_figures.operating(simulated)),
        "Sessions by the drone's distance from its claim, at 13 m. Between the two lines they stay inconclusive. "
        "Dashed: "
        "what the paper's rule accepts after one round.",
        describes="Share of sessions verified and refuted by the drone's distance from its claim",
    )
    document.figure(
        svg(goal_figures.edges(simulated)),
        "Drones exactly on the buffer's edge, the hardest case on both sides. Dashed: the limit of 1 %. A floor is "
        "bias "
        "that no number of rounds averages out.",
        describes="Error rates at the edge of the buffer, all below one per cent",
    )
    document.figure(
        svg(goal_figures.calibration(simulated)),
        "The likelihood means what it says. Drones anywhere about their claims, by tenths of the stated likelihood. "
        "Dots: estimates drawn with the covariance that they are judged with (right: the difference). Squares: whole "
        "sessions at the paper's points, biases drawn, judged by the contract's own decision, with 95 % intervals.",
        describes="Reliability diagram of the likelihood and its difference in points",
    )
    document.table(
        "Error of the estimate over the Cramér–Rao bound. On the same noise as the linearised estimate, whose error "
        "is "
        "the bound, so that chance falls out.",
        ["Point", *(Cell(f"N = {n}", "n") for n in next(iter(simulated.ratios.values())))],
        [
            [name, *(Cell(f"{ratio:.3f}", "n") for ratio in by_rounds.values())]
            for name, by_rounds in simulated.ratios.items()
        ],
    )


def _paper_section(document: Document, runs: Sequence[PaperRun]) -> None:
    document.section("The paper's experiment")
    document.text(
        "Fu et al. validate a drone at two short and two long distances with a rule: the estimate within a metre of "
        "the "
        "claim. Here its anchors and positions go the whole way: virtual UWB nodes speak UCI on serial ports, agents "
        "range and sign, the contract on an embedded ledger decides. Ranges are drawn with the noise that fits the "
        "paper's own error circles.",
    )
    document.figure(
        svg(paper_figures.positions(runs)),
        "Its two figures again, and each point closely. The error is nearly all bearing: an ellipse thirty times as "
        "long "
        "as wide, which a circle hides.",
        describes="Positions of anchors, claims, estimates and error ellipses at the paper's four points",
    )
    document.table(
        "The four points. Bound: one standard deviation by Cramér and Rao for the rounds that were ranged.",
        [
            "Point",
            "Outcome",
            *(
                Cell(name, "n")
                for name in ("Likelihood", "Error", "Rounds", "Bound", "Bound, 1 round", "Paper's circle")
            ),
        ],
        [
            [
                line["point"],
                line["outcome"],
                Cell(_likelihood(line), "n"),
                Cell(f"{line.get('error_m', 0.0):.2f} m", "n"),
                Cell(str(line["rounds"]), "n"),
                Cell(f"{line['cramer_rao_m']:.2f} m", "n"),
                Cell(f"{line['cramer_rao_one_round_m']:.2f} m", "n"),
                Cell(f"{line['paper_error_m']:.3f} m", "n"),
            ]
            for line in (run.line() for run in runs)
        ],
    )
    document.figure(
        svg(paper_figures.sequence(runs)),
        "Its eight steps, with times from these runs. Blue: by the ledger; red: by UWB. Ranging takes as long as the "
        "place demands; the rest is much the same everywhere.",
        describes="Sequence diagram of the eight steps with their times, and bars of their durations",
    )
    document.table(
        "Milliseconds from the request to the end of each step.",
        ["Step", *(Cell(run.point.name, "n") for run in runs)],
        [
            [
                f"{number} {name}",
                *(Cell(f"{run.steps_ms[name]:,}" if name in run.steps_ms else "–", "n") for run in runs),
            ]
            for number, name in enumerate(STEP_NAMES, start=1)
        ],
    )


def _likelihood(line: dict[str, Any]) -> str:
    """Never rounded up to certainty."""
    value = line.get("likelihood", 0.0)
    return "> 0.9999" if value > 0.9999 else f"{value:.4f}"


def _attacks(document: Document, lab: LabResult) -> None:
    document.section("Attacks")
    document.text(
        f"{lab.tries:,} tries of each attack on the decision's own functions, at each level of assurance at which it "
        "makes sense. What each attacker has in hand, what it costs, and what stops it is in the threat model; the "
        "same "
        "attacks go through real agents and a ledger with `wonderland attack --wire`."
    )
    with tempfile.TemporaryDirectory(prefix="wonderland-report-") as folder:
        path = Path(folder) / "permissions.svg"
        draw_permissions(lab, path)
        drawing = path.read_text(encoding="utf-8")
    document.figure(
        drawing[drawing.index("<svg") :],
        "Permissions won. None seen: the bar ends at the upper bound.",
        describes="Share of tries with a permission for each attack and level of assurance",
    )
    rows: list[list[str | Cell]] = []
    for family, title in FAMILIES.items():
        for attack in (one for one in lab.attacks if one.family == family):
            for number, (levels, one) in enumerate(grouped(attack.levels)):
                bound = (
                    f"≤ {percent(one.won_high)}" if not one.won else f"{percent(one.won_low)}–{percent(one.won_high)}"
                )
                rows.append(
                    [
                        f"{attack.title}" if not number else "",
                        title if not number else "",
                        Cell(span(levels), "n"),
                        Cell(share(one.won, one.tries), "n"),
                        Cell(bound, "n"),
                        Cell(share(one.refuted + one.refused, one.tries), "n"),
                        Cell(found_after(one), "n"),
                    ]
                )
    document.table(
        "Attacks by level of assurance. Found after: seconds of ranging until it was refuted, median (95 %).",
        ["Attack", "Kind", *(Cell(name, "n") for name in ("Level", "Won", "95 %", "Refuted", "Found after"))],
        rows,
    )


def _limits(document: Document, results: Results) -> None:
    document.section("What limits it")
    simulated = results.simulated
    largest = ", ".join(f"{bias} mm at {name}" for name, bias in simulated.largest_bias_mm.items())
    document.text(
        f"*Bias, not noise.* Noise averages out, bias does not. The largest bias (1σ, each anchor) with which this "
        "pad "
        f"can verify even an exact claim is {largest}. A wider pad tolerates more in proportion: the long points lie "
        "twenty-five baselines away.",
        "*Honest claims are dearer than lies.* A lie has to be proved on one side of the edge, an honest claim on "
        "both; "
        f"{honest_ratio(simulated):.2f} times Wald's one-sided bound is what that costs here.",
        "*The pad's looks.* Each look costs a claim and a burst of frames on the air, so that the pad looks after "
        "10, 12, "
        "14, 17 … rounds and not after each; a session takes some rounds more for it.",
        "*Drones a little outside.* Between one and about two buffers a drone is often neither proved inside nor "
        "outside "
        "within the pad's 160 rounds. It is then told so, and gets no permission.",
    )
    if results.hyu is not None:
        document.text(
            "*Real ranges.* Two recordings of some minutes cannot show a rate of 0.1 %; their intervals are given "
            "instead."
        )


def honest_ratio(simulated: Simulated) -> float:
    """Rounds of honest claims over Wald's bound, at every round."""
    return simulated.sessions["every", 0.0].mean_rounds / wald_rounds(0.0)


def _lab(settings: ReportSettings, progress: Progress) -> LabResult:
    lab_settings = LabSettings(tries=settings.tries, seed=settings.seed)
    task = progress.add_task("Attacks", total=sum(total_tries(lab_settings).values()))

    def heard(name: str, tries: int) -> None:
        progress.update(task, description=f"Attack: {name}", advance=tries)

    return run_lab(lab_settings, heard)


async def _paper(settings: ReportSettings, console: Console, progress: Progress) -> list[PaperRun]:
    task = progress.add_task("The paper's points", total=len(POINTS))
    runs = []
    for point in POINTS:

        def say(text: str, name: str = point.name) -> None:
            progress.update(task, description=f"{name}: {text}")

        runs.append(await run_point(point, settings.seed, console, say))
        progress.advance(task)
    return runs
