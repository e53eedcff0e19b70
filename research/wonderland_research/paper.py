"""The paper's experiment (section 4): its anchors and its four points, from the figures, sent the whole way.

Ranges are drawn with the noise that fits the paper's own error circles (σ = 5 cm in each range), the claims are the
motion-capture positions that it broadcast, the buffer is its metre. Height is not in the paper: anchors and drone are
taken at the same height, as its figures do.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from wonderland.consoles import for_people
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland.proofs.records.verdicts import Verdict
from wonderland_edge_agent.geodesy import frame_at
from wonderland_research.paper_points import POINTS, SIGMA_M, PaperPoint, PaperRun
from wonderland_simulator.flight import Vector
from wonderland_simulator.playback import Playback
from wonderland_simulator.recording import RecordedRound, Recording
from wonderland_simulator.scenario import DAY_MS, Behaviour, DroneSpec, PadSite
from wonderland_simulator.simulate import Player
from wonderland_simulator.stage import ProcessError, Stage, StageSettings
from wonderland_simulator.verdicts import CommittedVerdict

MAX_ROUNDS: Final = 160
ROUNDS_RECORDED: Final = 400


def recording_of(point: PaperPoint, seed: int) -> Recording:
    """Simulated ranges at a point, round after round."""
    rng = random.Random(f"{seed}/{point.name}")
    anchors: dict[str, Vector] = {f"A{i + 1}": (x, y, 0.0) for i, (x, y) in enumerate(point.anchors)}
    truth: Vector = (point.position[0], point.position[1], 0.0)
    rounds = tuple(
        RecordedRound(
            0.05 * index,
            {name: math.dist(truth, place) + rng.gauss(0.0, SIGMA_M) for name, place in anchors.items()},
            truth,
        )
        for index in range(ROUNDS_RECORDED)
    )
    return Recording(rounds, anchors)


def commissioning_of(pad: PadSite, now_ms: int) -> Commissioning:
    """The paper's anchors are known by motion capture; their ranges have no bias in this model."""
    return Commissioning(
        frame=frame_at(pad.lat_e7, pad.lon_e7, pad.height_mm),
        anchors=tuple(
            Anchor(
                anchor_id=site.anchor_id,
                mac=site.mac,
                east_mm=round(site.east_m * 1000),
                north_mm=round(site.north_m * 1000),
                up_mm=0,
                survey_sigma_mm=1,
                bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=1),),
            )
            for site in pad.anchors
        ),
        range_sigma_mm=round(SIGMA_M * 1000),
        installation_sigma_mm=0,
        max_range_mm=50_000,
        valid_from_ms=now_ms - DAY_MS,
        valid_until_ms=now_ms + DAY_MS,
        method="Motion capture (the paper, section 4.4)",
    )


async def reproduce(*, seed: int, as_json: bool, plot: Path | None, sequence: Path | None) -> int:
    """All four points; the exit code."""
    console = for_people(stderr=as_json)
    results: list[PaperRun] = []
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("Starting", total=len(POINTS))
        for point in POINTS:

            def say(text: str, name: str = point.name) -> None:
                progress.update(task, description=f"{name}: {text}")

            results.append(await run_point(point, seed, console, say))
            progress.advance(task)
            if as_json:
                print(json.dumps(results[-1].line()), flush=True)  # noqa: T201 - the product of --json
    if not as_json:
        console.print(_table(results))
        console.print(_steps_table(results))
    if plot is not None or sequence is not None:
        from wonderland_research.reproduction import paper_figures  # noqa: PLC0415 - matplotlib takes a second
        from wonderland_research.reproduction.style import save  # noqa: PLC0415

        for path, draw in ((plot, paper_figures.positions), (sequence, paper_figures.sequence)):
            if path is not None:
                save(draw(results), path)
                console.print(f"Drawn: {path}")
    return 0 if all(run.item.verdict.outcome == "verified" for run in results) else 1


async def run_point(point: PaperPoint, seed: int, console: Console, say: Callable[[str], None]) -> PaperRun:
    """A point the whole way: virtual nodes on serial ports, agents, an embedded ledger. Raises ProcessError."""
    recording = recording_of(point, seed)
    pad = recording.pad(f"paper-{point.name.lower()}")
    drone = DroneSpec("ALICE", "TDrone M690B", pad.pad_id, "land", Behaviour.HONEST, (0, 0, 0), (0, 0, 0), 0.0)
    now_ms = time.time_ns() // 1_000_000
    permitted: list[int] = []

    async def land(verdict: Verdict) -> str:
        del verdict
        permitted.append(time.time_ns() // 1_000_000)
        return "done"

    with tempfile.TemporaryDirectory(prefix="wonderland-paper-") as folder:
        stage = Stage(
            Path(folder),
            StageSettings(
                (pad,),
                (drone,),
                policy=lambda _: Policy(min_rounds=10, max_rounds=MAX_ROUNDS, min_assurance=2),
                commissioning=lambda site: commissioning_of(site, now_ms),
            ),
            say=say,
        )
        async with stage:
            port = stage.ports.position[drone.uav_id]
            playback = Playback(recording, pad, drone.uav_id, stage.directory, port, lambda truth: truth)
            air = asyncio.ensure_future(playback.run())
            try:
                await stage.start_pads()
                say("ranging")
                shown: list[CommittedVerdict] = []
                player = Player(stage, playback, drone.uav_id, console, lambda item, *_: shown.append(item), land)
                await player.play(windows=1, rounds=10)
            finally:
                air.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await air
    if not shown:
        raise ProcessError(f"{point.name}: no verdict after several tries; the lines above say why")
    return PaperRun(point, shown[0], permitted[0] if permitted else None)


def _steps_table(results: list[PaperRun]) -> Table:
    table = Table(title="The eight steps, milliseconds since the request")
    table.add_column("Step")
    for run in results:
        table.add_column(run.point.name, justify="right")
    for name in STEP_NAMES:
        table.add_row(name, *(str(run.steps_ms.get(name, "–")) for run in results))
    return table


def _table(results: list[PaperRun]) -> Table:
    table = Table(title="The paper's four points, the whole way (buffer 1 m, σ 5 cm)")
    for column in (
        "Point",
        "Outcome",
        "Likelihood",
        "Error",
        "Rounds",
        "Bound (CRLB)",
        "The paper's circle",
        "Its rule",
    ):
        table.add_column(column)
    for run in results:
        point, item, line = run.point, run.item, run.line()
        table.add_row(
            point.name,
            item.verdict.outcome,
            f"{line.get('likelihood', 0):.4f}",
            f"{line.get('error_m', float('nan')):.3f} m",
            str(item.verdict.rounds),
            f"{line['cramer_rao_m']:.3f} m",
            f"{point.paper_error_m:.3f} m",
            "accepts" if line.get("paper_rule") else "refuses",
        )
    return table
