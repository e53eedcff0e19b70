"""The demo: everything on this machine, three pads, eleven drones, a ledger and a live map."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape

from wonderland import messages
from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_simulator.place.archive import is_whole
from wonderland_simulator.place.making import archive_path, start_making
from wonderland_simulator.scenarios import DEFAULT, SCENARIOS
from wonderland_simulator.stage import ProcessError, Stage, StageSettings
from wonderland_simulator.verdicts import CommittedVerdict, committed

STYLES: Final = {"verified": "green", "refuted": "red", "inconclusive": "yellow", "unauthorised": "magenta"}
SHAPES: Final = {"verified": "●", "refuted": "⯃", "inconclusive": "▲", "unauthorised": "■"}
WATCH_S: Final = 0.5


@dataclass(frozen=True)
class DemoSettings:
    """What the command line asked for. ``until``: stop after so many verdicts, 0 for never."""

    headless: bool = False
    as_json: bool = False
    until: int = 0
    seed: int = 1
    port: int = 0
    directory: Path | None = None
    ledger: str = "embedded"
    scenario: str = DEFAULT


def console_directory() -> Path | None:
    """The built console: beside this checkout's sources, or None where it was not built."""
    built = Path(__file__).resolve().parents[2] / "frontend" / "dist"
    return built if (built / "index.html").exists() else None


async def run(settings: DemoSettings) -> int:
    """Run it; the exit code."""
    console = Console(stderr=settings.as_json, highlight=False)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, stop.set)
    directory = settings.directory or Path(tempfile.mkdtemp(prefix="wonderland-demo-"))
    main = asyncio.ensure_future(_main(settings, directory, console))
    stopping = asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait({main, stopping}, return_when=asyncio.FIRST_COMPLETED)
        if stop.is_set() and not main.done():
            console.print("\nStopping…")
            main.cancel()
        code = 0
        with contextlib.suppress(asyncio.CancelledError):
            code = await main
    except ProcessError as error:
        console.print(f"[red]{error}[/red]")
        console.print(f"Logs are in {directory / 'logs'}")
        return 1
    else:
        return code
    finally:
        stopping.cancel()
        if settings.directory is None:
            shutil.rmtree(directory, ignore_errors=True)


async def _main(settings: DemoSettings, directory: Path, console: Console) -> int:
    started = time.monotonic()
    served = None if settings.headless else console_directory()
    if not settings.headless and served is None:
        console.print(
            "[yellow]The console is not built here (make setup builds it): only its API will answer.[/yellow]"
        )
    scenario = SCENARIOS[settings.scenario]
    place = _Place(console) if scenario.has_place and served is not None else None
    with console.status("Starting") as status:
        stage = Stage(
            directory,
            StageSettings(
                scenario.pads,
                scenario.drones,
                console=served,
                port=settings.port,
                ledger=settings.ledger,
                pad_operator=scenario.pad_operator,
                map_archive=None if place is None else place.archive,
            ),
            say=lambda text: status.update(f"{text}…"),
        )
        await stage.__aenter__()
    try:
        url, token = stage.backend.ready["url"].rstrip("/"), stage.backend.ready["token"]
        if settings.ledger == "embedded":
            console.print(f"[yellow]{NOTICE}[/yellow]")
        if not settings.headless:
            console.print("\n  Open the live map:", style="bold")
            console.print(f"  {url}/#token={token}\n", soft_wrap=True, style="cyan")
            console.print("  The link opens it once. Ctrl-C stops everything.\n")
        with console.status("Starting the world") as status:
            stage.say = lambda text: status.update(f"{text}…")
            await stage.start_world(seed=settings.seed)
        if place is not None:
            place.begin()
        console.print(f"[dim]Drones are on their way ({time.monotonic() - started:.1f} s after the start).[/dim]")
        return await _show(settings, stage, console, started)
    finally:
        if place is not None:
            await place.end()
        await stage.__aexit__()


class _Place:
    """The map of the place where the demo flies: made in the background if set-up has not, and never waited for."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self.archive = archive_path()
        self._making: asyncio.Future[None] | None = None

    def begin(self) -> None:
        """After the page is there: nobody waits for the map."""
        if not is_whole(self.archive):
            self._making = asyncio.ensure_future(self._make())

    async def end(self) -> None:
        """Let the making go on by itself: the next demo has its map."""
        if self._making is not None:
            self._making.cancel()
            await asyncio.gather(self._making, return_exceptions=True)

    async def _make(self) -> None:
        self._console.print("[dim]The map of the place is being made; it appears by itself.[/dim]")
        process = await start_making()
        _, said = await process.communicate()
        if process.returncode != 0:
            why = (said.decode(errors="replace").strip().splitlines() or ["no reason given"])[-1]
            self._console.print(f"[yellow]No map of the place: {escape(why)}. Coasts and borders instead.[/yellow]")


async def _show(settings: DemoSettings, stage: Stage, console: Console, started: float) -> int:
    channel = stage.connection.open_channel()
    try:
        count = 0
        async for item in _watched(stage, committed(stage.connection, channel)):
            count += 1
            if settings.as_json:
                print(json.dumps(item.line()), flush=True)  # noqa: T201 - the product of --json
            else:
                console.print(_sentence(item, time.monotonic() - started), soft_wrap=True)
            if settings.until and count >= settings.until:
                return 0
        return 1
    finally:
        await channel.close()


async def _watched(stage: Stage, verdicts: AsyncIterator[CommittedVerdict]) -> AsyncIterator[CommittedVerdict]:
    """The verdicts, as long as every process lives; raises ProcessError when one has ended by itself."""
    pending: asyncio.Future[CommittedVerdict] | None = None
    try:
        while True:
            pending = pending or asyncio.ensure_future(anext(verdicts))
            done, _ = await asyncio.wait({pending}, timeout=WATCH_S)
            if done:
                yield pending.result()
                pending = None
            ended = stage.processes.ended()
            if ended is not None:
                raise ProcessError(
                    f"{ended.name} ended by itself (code {ended.handle.returncode}).\n{ended.last_words()}"
                )
    finally:
        if pending is not None:
            pending.cancel()
            with contextlib.suppress(asyncio.CancelledError, StopAsyncIteration):
                await pending


def _sentence(item: CommittedVerdict, after_s: float) -> str:
    """One verdict in words."""
    verdict = item.verdict
    style = STYLES[item.answer]
    parts = [
        f"[{style}]{SHAPES[item.answer]} {item.answer.capitalize():<12}[/{style}] {verdict.uav_id} at {verdict.pad_id}"
    ]
    if verdict.signed is not None:
        # Time stamps or the height refute drones whose ranges, taken alone, agree with them.
        alone = verdict.outcome == "refuted" and verdict.signed.error_mm <= verdict.buffer_mm
        parts.append(f"{verdict.signed.error_mm / 1000:.2f} m from its claim{' by its ranges alone' if alone else ''}")
    heard = verdict.broadcast
    if heard is not None and heard.error_mm is not None and heard.outcome.endswith("contradicted"):
        parts.append(f"its serial number is broadcast {heard.error_mm / 1000:.0f} m away")
    parts.append(f"{verdict.action} {verdict.permission}")
    if item.answer != "verified" and verdict.reasons:
        parts.append(messages.text("reasons", verdict.reasons[-1].code, verdict.reasons[-1].facts))
    took = sum(item.step_ms().values())
    return f"{' · '.join(parts)} [dim]{took} ms, tx {item.tx_id[:8]}…, {after_s:.0f} s[/dim]"


def main(settings: DemoSettings) -> int:
    """The demo as a program."""
    if sys.platform == "win32":
        Console(stderr=True).print("The demo needs pseudo-terminals: run it on Linux or macOS, or in WSL.")
        return 2
    return asyncio.run(run(settings))
