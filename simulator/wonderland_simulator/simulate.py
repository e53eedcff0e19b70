"""``wonderland simulate``: recorded ranges go the whole way, and each window gets a verdict.

Radio bytes → agent → signed transaction → endorsement → block → mirror: only the air is a recording.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import httpx
from rich.console import Console
from rich.progress import Progress

from wonderland.clock import SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.verdicts import OUTCOMES, Verdict
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_simulator.flight import Vector
from wonderland_simulator.playback import Playback
from wonderland_simulator.recording import Recording, RecordingError, dw1000_commissioning
from wonderland_simulator.scenario import Behaviour, DroneSpec, PadSite
from wonderland_simulator.stage import Stage, StageSettings
from wonderland_simulator.verdicts import CommittedVerdict, committed
from wonderland_simulator.world import drone_path
from wonderland_uav_agent.agent import UavAgent, UavAgentError
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.position.autopilot import AutopilotPosition
from wonderland_uav_agent.radio import UavRadio

UAV_ID: Final = "RECORDED"
VERDICT_S: Final = 20.0
MIRROR_S: Final = 15.0
TRIES: Final = 5
RETRY_S: Final = 1.0
POSITION_S: Final = 10.0
MIN_ROUNDS: Final = 5
"""Recordings have rounds with too few anchors, so that a window of N rounds must not need N usable ones."""


@dataclass(frozen=True)
class SimulateSettings:
    """What the command line asked for. Lengths in metres, times in seconds."""

    recording: Path
    anchors: Path
    claim: str = "truth"
    truth_shift_s: float = 0.0
    truth_raise_m: float = 0.0
    rounds: int = 20
    windows: int = 0
    commissioning: Path | None = None
    as_json: bool = False


def parse_claim(text: str) -> Callable[[Vector], Vector]:
    """``truth`` or ``offset:E,N,U`` in metres; raises RecordingError for anything else."""
    if text == "truth":
        return lambda truth: truth
    kind, _, rest = text.partition(":")
    with contextlib.suppress(ValueError):
        if kind == "offset":
            east, north, up = (float(part) for part in rest.split(","))
            if not all(math.isfinite(value) for value in (east, north, up)):
                raise RecordingError(f"--claim {text!r}: three finite numbers, in metres")
            return lambda truth: (truth[0] + east, truth[1] + north, truth[2] + up)
    raise RecordingError(f"--claim {text!r}: say truth, or offset:E,N,U in metres, for example offset:3,0,0")


async def run(settings: SimulateSettings) -> int:
    """Play it; the exit code."""
    recording = Recording.load(
        settings.recording,
        settings.anchors,
        truth_shift_s=settings.truth_shift_s,
        truth_raise_m=settings.truth_raise_m,
    )
    said = parse_claim(settings.claim)
    pad = recording.pad()
    drone = DroneSpec(UAV_ID, "Recorded tag", pad.pad_id, "land", Behaviour.HONEST, (0, 0, 0), (0, 0, 0), 0.0)
    console = Console(stderr=settings.as_json, highlight=False)
    with (
        tempfile.TemporaryDirectory(prefix="wonderland-simulate-") as folder,
        Progress(console=console, transient=True) as progress,
    ):
        directory = Path(folder)
        task = progress.add_task("Starting", total=len(recording.rounds))
        stage = Stage(
            directory,
            StageSettings(
                (pad,),
                (drone,),
                policy=lambda _: Policy(
                    min_rounds=max(MIN_ROUNDS, settings.rounds // 2), max_rounds=settings.rounds, min_assurance=2
                ),
                commissioning=_commissioning(settings.commissioning),
            ),
            say=lambda text: progress.update(task, description=text),
        )
        async with stage:
            playback = Playback(recording, pad, UAV_ID, directory, stage.ports.position[UAV_ID], said)
            air = asyncio.ensure_future(playback.run())
            try:
                await stage.start_pads()
                progress.update(task, description="Playing")
                printer = _Printer(console, as_json=settings.as_json)
                player = Player(stage, playback, UAV_ID, console, printer.show)
                await player.play(
                    windows=settings.windows,
                    rounds=settings.rounds,
                    progress=lambda: progress.update(task, completed=playback.played),
                )
                mirrored = await _mirrored(stage, player.count)
            finally:
                air.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await air
        counts = ", ".join(f"{printer.outcomes[name]} {name}" for name in OUTCOMES)
        console.print(f"{player.count} windows: {counts}; {player.failed} without a verdict; {mirrored} in the mirror")
    return 0 if player.count and mirrored == player.count else 1


Act = Callable[[Verdict], Awaitable[str]]
Show = Callable[[CommittedVerdict, float, float], None]
"""Hears each verdict with the recorded time (s) at which its window began and ended."""


class Player:
    """Proves window after window until the recording is over."""

    def __init__(
        self, stage: Stage, playback: Playback, uav_id: str, console: Console, show: Show, act: Act | None = None
    ) -> None:
        """``act``: what the drone does with its permission; nothing unless given."""
        self._stage = stage
        self._act = act or _land_at_once
        self._playback = playback
        self._uav_id = uav_id
        self._console = console
        self._show = show
        self.count = 0
        self.failed = 0

    async def play(self, *, windows: int, rounds: int, progress: Callable[[], None] = lambda: None) -> None:
        """Until ``windows`` have a verdict (0: all), or fewer than ``rounds`` rounds are left."""
        connection = self._stage.connection
        identity, signer, clock = connection.identity(self._uav_id), connection.signer(self._uav_id), SteadyClock()
        async with AsyncExitStack() as stack:
            channel = connection.open_channel()
            stack.push_async_callback(channel.close)
            contract = ProofContract(
                Gateway(channel, identity, signer).network(connection.channel), connection.chaincode
            )
            verdicts = committed(connection, channel)
            stack.push_async_callback(verdicts.aclose)
            radio = await stack.enter_async_context(UavRadio(drone_path(self._stage.directory, self._uav_id), clock))
            port = self._stage.ports.position[self._uav_id]
            position = await stack.enter_async_context(AutopilotPosition(("127.0.0.1", port), clock))
            events = await stack.enter_async_context(LedgerEvents(contract))
            agent = UavAgent(
                uav_id=self._uav_id,
                ledger=contract,
                events=events,
                identity=identity,
                signer=signer,
                radio=radio,
                position=position,
                act=self._act,
                clock=clock,
            )
            await position.wait(POSITION_S)
            tries = 0
            while self._playback.left >= rounds and tries < TRIES and not (windows and self.count >= windows):
                first_s = self._playback.position_s
                try:
                    result = await agent.prove(self._stage.settings.pads[0].pad_id, "land")
                except (UavAgentError, LedgerError) as error:
                    tries += 1
                    self._console.print(f"[yellow]No proof at {first_s:.1f} s: {error}[/yellow]")
                    await asyncio.sleep(RETRY_S)
                    continue
                if result.verdict is None:
                    self.failed += 1
                    tries += 1
                    self._console.print(f"[yellow]No verdict at {first_s:.1f} s: {result.end} {result.detail}[/yellow]")
                    continue
                tries = 0
                async with asyncio.timeout(VERDICT_S):
                    item = await _of_session(verdicts, result.session_id)
                self.count += 1
                self._show(item, first_s, self._playback.position_s)
                progress()


class _Printer:
    """A line for each window, for people or for machines."""

    def __init__(self, console: Console, *, as_json: bool) -> None:
        self._console = console
        self._as_json = as_json
        self.outcomes = dict.fromkeys(OUTCOMES, 0)

    def show(self, item: CommittedVerdict, first_s: float, last_s: float) -> None:
        self.outcomes[item.verdict.outcome] += 1
        line: dict[str, Any] = {"from_s": round(first_s, 3), "to_s": round(last_s, 3), **item.line()}
        if self._as_json:
            print(json.dumps(line), flush=True)  # noqa: T201 - the product of --json
            return
        error = f"{line['error_m']:.2f} m" if "error_m" in line else "–"
        likelihood = f"{line['likelihood']:.4f}" if "likelihood" in line else "–"
        self._console.print(
            f"{first_s:8.1f}–{last_s:.1f} s  {item.verdict.outcome:<12} likelihood {likelihood}  error {error}  "
            f"rounds {item.verdict.rounds}  [dim]{', '.join(line['reasons'])}[/dim]",
            soft_wrap=True,
        )


async def _of_session(verdicts: Any, session_id: str) -> CommittedVerdict:
    async for item in verdicts:
        if item.verdict.session_id == session_id:
            return item  # type: ignore[no-any-return]
    raise LedgerError("the ledger's block stream ended")


async def _land_at_once(verdict: Verdict) -> str:
    del verdict
    return "done"


def _commissioning(path: Path | None) -> Callable[[PadSite], Commissioning]:
    now_ms = time.time_ns() // 1_000_000
    if path is None:
        return lambda pad: dw1000_commissioning(pad, now_ms)
    try:
        record = Commissioning.decode(path.read_bytes())
    except (OSError, ProofError) as error:
        raise RecordingError(f"{path}: no commissioning record ({error})") from error
    return lambda _: record


async def _mirrored(stage: Stage, expected: int) -> int:
    """How many of the verdicts the backend's mirror has, as its REST interface says."""
    url = stage.backend.ready["url"].rstrip("/")
    async with httpx.AsyncClient(base_url=url, timeout=10.0) as client:
        answer = await client.post("/api/v1/session", json={"token": stage.backend.ready["token"]})
        answer.raise_for_status()
        deadline = asyncio.get_running_loop().time() + MIRROR_S
        while True:
            count, cursor = 0, ""
            while True:
                page = (
                    await client.get(
                        "/api/v1/verdicts", params={"limit": 200, **({"cursor": cursor} if cursor else {})}
                    )
                ).json()
                count += len(page["items"])
                cursor = page.get("next") or ""
                if not cursor:
                    break
            if count >= expected or asyncio.get_running_loop().time() > deadline:
                return count
            await asyncio.sleep(0.2)
