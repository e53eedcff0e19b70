"""One of each attack the whole way: UCI bytes on serial ports, the agents' processes, signed transactions, blocks.

Drones that attack by radio or by word fly at the demo's three pads, all in one world; what they are told is read from
the ledger's blocks. Attacks on the protocol (``simulator.attack_lab.wire_ledger``) go to the same ledger afterwards.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import tempfile
import time
from collections.abc import AsyncIterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from simulator.attack_lab.run import chosen
from simulator.attack_lab.wire_ledger import LedgerAttacker
from simulator.scenario import PADS, AttackSpec, Behaviour, DroneSpec, PadSite
from simulator.stage import ProcessError, Processes, Stage, StageSettings
from simulator.verdicts import CommittedVerdict, committed
from wonderland.proofs.records.policies import Policy

PATIENCE_S: Final = 120.0
"""Longest time in which no verdict comes before the run is given up."""
WATCH_S: Final = 0.5
LEVEL: Final = 2
"""What landing demands here."""
TIMED_LEVEL: Final = 3
"""What docking demands at the pad whose nodes share a clock."""
TIMED: Final = ("honest", "gnss-offset", "delay-line", "uniform-stamp-lie", "per-anchor-stamp-lie")
"""Flown a second time there."""
AT_TIMED: Final = "@3"
_HOVERS: Final = ((5.5, -6.5, 6.0), (-7.0, 4.0, 5.0), (6.0, 6.0, 6.0), (-6.5, -5.0, 5.5), (4.0, 8.0, 6.0))
_FAR: Final = 12.0
LEDGER_ATTACKS: Final = ("prekey-reuse", "many-sessions", "session-replay", "pad-alone", "wrong-role")


@dataclass(frozen=True)
class WireResult:
    """How one attack ended on the wire."""

    attack: str
    pad: str
    outcome: str
    permission: str
    rounds: int
    assurance: int
    reasons: tuple[str, ...]
    tx_id: str
    as_documented: bool


def specs() -> dict[str, tuple[Behaviour, AttackSpec | None]]:
    """What a drone does for each attack that has a sample on the wire."""
    lie = (4.0, -3.0, 0.0)
    outward = (4.0, -4.7, 0.0)

    def ranging(name: str, ranges: str, lie_m: tuple[float, float, float] = lie) -> tuple[Behaviour, AttackSpec]:
        return Behaviour.ATTACK, AttackSpec(name, lie_m=lie_m, ranges=ranges)

    return {
        "honest": (Behaviour.HONEST, None),
        "gnss-offset": (Behaviour.ATTACK, AttackSpec("gnss-offset", spoofed_m=(4.0, -3.0))),
        "gnss-drag": (Behaviour.GNSS_DRAGGED, None),
        "gnss-drag-slow": (Behaviour.ATTACK, AttackSpec("gnss-drag-slow", drag_m_s=0.6)),
        "gnss-meaconing": (Behaviour.ATTACK, AttackSpec("gnss-meaconing", spoofed_m=(-12.0, 9.0))),
        "remote-id-lie": (Behaviour.FALSE_BROADCAST, None),
        "vague-claim": (
            Behaviour.ATTACK,
            AttackSpec("vague-claim", lie_m=lie, accuracy_m=20.0, height_accuracy_m=20.0),
        ),
        "height-lie": (Behaviour.ATTACK, AttackSpec("height-lie", lie_m=(2.5, -2.5, -3.5))),
        "random-reduction": ranging("random-reduction", "random-reduction"),
        "relay": ranging("relay", "relay"),
        "mixed-rounds": ranging("mixed-rounds", "mixed"),
        "delay-line": ranging("delay-line", "delay", outward),
        "uniform-stamp-lie": ranging("uniform-stamp-lie", "uniform", outward),
        "per-anchor-stamp-lie": ranging("per-anchor-stamp-lie", "per-anchor"),
        "compromised-anchor": ranging("compromised-anchor", "one-anchor"),
        "anchor-moved": ranging("anchor-moved", "anchor-moved"),
        "session-replay": (Behaviour.REPLAY, None),
    }


def drones(names: Sequence[str], pads: Sequence[PadSite] = PADS) -> dict[str, DroneSpec]:
    """A drone for each attack, spread over the pads, each with a place of its own to hover.

    Landing goes to the pads without a common clock; what is in ``TIMED`` also docks at the one that has it, under the
    attack's name and ``AT_TIMED``.
    """
    known = specs()
    plain = [pad for pad in pads if pad.clock_sigma_mm is None]
    timed = [pad for pad in pads if pad.clock_sigma_mm is not None]
    flights = [(name, plain[number % len(plain)], "land") for number, name in enumerate(names)]
    flights += [(name + AT_TIMED, pad, "dock") for pad in timed for name in names if name in TIMED]
    result = {}
    for number, (key, pad, action) in enumerate(flights):
        behaviour, attack = known[key.removesuffix(AT_TIMED)]
        hover = _HOVERS[number % len(_HOVERS)]
        away = (hover[0] * _FAR, hover[1] * _FAR, hover[2] + 20.0)
        result[key] = DroneSpec(
            f"LAB-{number:04d}", key, pad.pad_id, action, behaviour, hover, away, 0.3 * number, attack=attack
        )
    return result


def policy(pad: PadSite) -> Policy:
    """One metre at every pad, so that each lie is of several buffers."""
    del pad
    return Policy(min_assurance=LEVEL)


async def fly(stage: Stage, flying: dict[str, DroneSpec]) -> AsyncIterator[tuple[WireResult, CommittedVerdict]]:
    """Each attack's first verdict, as the ledger has it; raises ProcessError when none comes for long."""
    names = {drone.uav_id: name for name, drone in flying.items()}
    documented = {attack.name: attack for attack in chosen(())}
    channel = stage.connection.open_channel()
    verdicts = committed(stage.connection, channel)
    waiting = dict(names)
    try:
        while waiting:
            item = await _next(stage.processes, verdicts, sorted(waiting.values()))
            name = waiting.pop(item.verdict.uav_id, None)
            if name is None:
                continue
            granted = item.verdict.permission == "granted"
            attack, level = name.removesuffix(AT_TIMED), TIMED_LEVEL if name.endswith(AT_TIMED) else LEVEL
            expected = granted if attack == "honest" else not (granted and documented[attack].stopped_at(level))
            yield _result(name, item, as_documented=expected), item
    finally:
        await verdicts.aclose()
        await channel.close()


async def attack_ledger(stage: Stage, granted: CommittedVerdict) -> list[WireResult]:
    """The attacks on the protocol, after a session that was granted; the agents of its pad and drones are stopped."""
    verdict = granted.verdict
    channel = stage.connection.open_channel()
    try:
        for name in ("fleet", f"pad-{verdict.pad_id}"):
            await stage.processes.stop(stage.processes.named(name))
        attacker = LedgerAttacker(stage.connection, channel, drone=verdict.uav_id, pad_id=verdict.pad_id)
        session = await attacker.session(verdict.session_id)
        return [
            WireResult(
                answer.attack,
                verdict.pad_id,
                answer.outcome,
                answer.permission,
                0,
                0,
                answer.reasons,
                "",
                answer.stopped,
            )
            for answer in await attacker.all(session, granted.evidence)
        ]
    finally:
        await channel.close()


async def run_wire(names: Sequence[str], *, seed: int, as_json: bool, directory: Path | None = None) -> int:
    """Fly one of each (or of those named), then attack the ledger itself; the exit code."""
    console = Console(stderr=as_json, highlight=False)
    there = specs()
    wanted = [name for name in (names or there) if name in there]
    started = time.monotonic()
    results: list[WireResult] = []
    with contextlib.ExitStack() as stack:
        place = directory or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="wonderland-attack-")))
        flying = drones(wanted)
        status = stack.enter_context(console.status("Starting"))
        async with Stage(
            place, StageSettings(PADS, list(flying.values()), policy=policy), say=lambda text: status.update(f"{text}…")
        ) as stage:
            await stage.start_world(seed=seed)
            status.update(f"{len(flying)} attackers are on their way")

            def note(result: WireResult) -> None:
                results.append(result)
                if as_json:
                    print(json.dumps(asdict(result)), flush=True)  # noqa: T201 - the product of --json

            granted: CommittedVerdict | None = None
            async for result, item in fly(stage, flying):
                note(result)
                status.update(f"{result.attack}: {result.outcome}; {len(flying) - len(results)} to come")
                if result.permission == "granted":
                    granted = item
            if granted is not None and set(LEDGER_ATTACKS) & set(names or LEDGER_ATTACKS):
                status.update("Attacking the ledger")
                for result in await attack_ledger(stage, granted):
                    note(result)
    if not as_json:
        console.print(_table(results))
        console.print(f"{time.monotonic() - started:.0f} s; every outcome is a committed transaction.")
    return 0 if all(result.as_documented for result in results) else 1


async def _next(
    processes: Processes, verdicts: AsyncIterator[CommittedVerdict], waiting: Sequence[str]
) -> CommittedVerdict:
    """The next verdict, as long as every process lives."""
    pending = asyncio.ensure_future(anext(verdicts))
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not pending.done():
                await asyncio.wait({pending}, timeout=WATCH_S)
                ended = processes.ended()
                if ended is not None:
                    raise ProcessError(f"{ended.name} ended by itself.\n{ended.last_words()}")
    except TimeoutError:
        raise ProcessError(f"no verdict for {PATIENCE_S:.0f} s; still without one: {', '.join(waiting)}") from None
    finally:
        if not pending.done():
            pending.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await pending
    return pending.result()


def _result(name: str, item: CommittedVerdict, *, as_documented: bool) -> WireResult:
    verdict = item.verdict
    return WireResult(
        name,
        verdict.pad_id,
        verdict.outcome,
        verdict.permission,
        verdict.rounds,
        verdict.assurance,
        tuple(reason.code for reason in verdict.reasons),
        item.tx_id,
        as_documented,
    )


def _table(results: Sequence[WireResult]) -> Table:
    table = Table(
        title="Through agents and ledger", title_justify="left", title_style="bold", box=None, padding=(0, 1, 0, 0)
    )
    for title in ("attack", "outcome", "permission", "level", "rounds", "reasons"):
        table.add_column(
            title, justify="right" if title == "rounds" else "left", no_wrap=title != "reasons", overflow="fold"
        )
    for one in results:
        level, rounds = str(one.assurance), str(one.rounds)
        cells: list[Any] = [one.attack, one.outcome, one.permission, level, rounds, "\n".join(one.reasons)]
        table.add_row(*cells, style="" if one.as_documented else "bold red")
    return table
