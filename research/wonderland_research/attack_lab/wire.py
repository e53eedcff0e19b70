"""One of each attack the whole way: UCI bytes on serial ports, the agents' processes, signed transactions, blocks.

Drones that attack by radio or by word fly at the demo's three pads and at the lab's own site (``wire_sites``), all in
one world, at assurance 2, 3 and 4; what they are told is read from the ledger's blocks. Attacks on the protocol
(``wonderland_research.attack_lab.wire_ledger``) go to the same ledger afterwards.
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

from rich.table import Table

from wonderland.consoles import for_people
from wonderland_research.attack_lab.wire_ledger import LedgerAttacker
from wonderland_research.attack_lab.wire_sites import (
    LEVEL,
    TIMED_LEVEL,
    WITNESSED_LEVEL,
    commissioning,
    documented,
    drones,
    may_be_granted,
    parsed,
    policy,
    sites_for,
)
from wonderland_simulator.scenario import AttackSpec, Behaviour, DroneSpec
from wonderland_simulator.stage import ProcessError, Processes, Stage, StageSettings
from wonderland_simulator.verdicts import CommittedVerdict, committed

PATIENCE_S: Final = 120.0
"""Longest time in which no verdict comes of a drone that still has none before the run is given up."""
WATCH_S: Final = 0.5
MOST_SESSIONS: Final = 4
"""So often a drone comes at most until a session tells something."""
NOTHING_HEARD: Final = frozenset({"codes_not_matched", "too_few_rounds", "no_witness", "no_time_stamps"})
UNANSWERED: Final = frozenset({"session-replay"})
"""Attacks whose codes never match: that is their end."""
LEDGER_ATTACKS: Final = ("prekey-reuse", "many-sessions", "session-replay", "pad-alone", "keyless-board", "wrong-role")


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
    sessions: int = 1
    """How often it had to come until a session told something."""


def specs() -> dict[str, tuple[Behaviour, AttackSpec | None]]:
    """What a drone does for each attack that has a sample on the wire."""
    lie = (4.0, -3.0, 0.0)
    outward = (4.0, -4.7, 0.0)

    def ranging(name: str, ranges: str, lie_m: tuple[float, float, float] = lie) -> tuple[Behaviour, AttackSpec]:
        return Behaviour.ATTACK, AttackSpec(name, lie_m=lie_m, ranges=ranges)

    return {
        "honest": (Behaviour.HONEST, None),
        "impostor": (Behaviour.HONEST, None),  # the attacker is another one (``wire_sites``)
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
        "height-offset": (Behaviour.ATTACK, AttackSpec("height-offset", lie_m=(0.0, 0.0, 3.0))),
        "mixed-claims": (Behaviour.ATTACK, AttackSpec("mixed-claims", lie_m=(7.5, 0.0, 0.0), lie_share=0.4)),
        "silent-anchors": ranging("silent-anchors", "silent-anchors"),
        "dropped-rounds": ranging("dropped-rounds", "dropped"),
        "random-reduction": ranging("random-reduction", "random-reduction"),
        "relay": ranging("relay", "relay"),
        "mixed-rounds": ranging("mixed-rounds", "mixed"),
        "delay-line": ranging("delay-line", "delay", outward),
        "uniform-stamp-lie": ranging("uniform-stamp-lie", "uniform", outward),
        "per-anchor-stamp-lie": ranging("per-anchor-stamp-lie", "per-anchor"),
        "compromised-anchor": ranging("compromised-anchor", "one-anchor"),
        "borrowed-identity": (Behaviour.ATTACK, AttackSpec("borrowed-identity", lie_m=lie, accomplice=True)),
        "anchor-moved": ranging("anchor-moved", "anchor-moved"),
        "anchors-turned": (Behaviour.ATTACK, AttackSpec("anchors-turned")),  # where to is its pad's affair
        "session-replay": (Behaviour.REPLAY, None),
    }


async def fly(stage: Stage, flying: dict[str, DroneSpec]) -> AsyncIterator[tuple[WireResult, CommittedVerdict]]:
    """Each attack's verdict, as the ledger has it; raises ProcessError when none comes for long.

    The first one that tells something: where a session came to nothing (a crowded machine, a witness that was busy with
    another drone), the drone comes again, ``MOST_SESSIONS`` times at most.
    """
    names = {drone.uav_id: name for name, drone in flying.items()}
    channel = stage.connection.open_channel()
    verdicts = committed(stage.connection, channel)
    waiting = dict(names)
    sessions = dict.fromkeys(names, 0)
    last_s = time.monotonic()
    try:
        while waiting:
            item = await _next(stage.processes, verdicts, sorted(waiting.values()))
            uav_id = item.verdict.uav_id
            name = waiting.get(uav_id)
            if name is None:  # who has its result flies on, and must not keep the run waiting for the others
                if time.monotonic() - last_s > PATIENCE_S:
                    raise _silent(sorted(waiting.values()))
                continue
            last_s = time.monotonic()
            sessions[uav_id] += 1
            if _came_to_nothing(name, item) and sessions[uav_id] < MOST_SESSIONS:
                continue
            del waiting[uav_id]
            granted = item.verdict.permission == "granted"
            yield _result(name, item, sessions[uav_id], as_documented=documented(*parsed(name), granted=granted)), item
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


async def run_wire(
    names: Sequence[str],
    *,
    seed: int,
    as_json: bool,
    directory: Path | None = None,
    levels: Sequence[int] = (LEVEL, TIMED_LEVEL, WITNESSED_LEVEL),
    report: Path | None = None,
) -> int:
    """Fly one of each (or of those named) at each level, then attack the ledger itself; the exit code.

    ``report``: a directory for ``wire.json`` and ``wire.md``.
    """
    console = for_people(stderr=as_json)
    there = specs()
    wanted = [name for name in (names or there) if name in there]
    started = time.monotonic()
    results: list[WireResult] = []
    with contextlib.ExitStack() as stack:
        place = directory or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="wonderland-attack-")))
        flying = drones(wanted, there, levels)
        pads = sites_for(wanted, levels)
        status = stack.enter_context(console.status("Starting"))
        now_ms = time.time_ns() // 1_000_000
        settings = StageSettings(
            pads, list(flying.values()), policy=policy, commissioning=lambda pad: commissioning(pad, now_ms)
        )
        async with Stage(place, settings, say=lambda text: status.update(f"{text}…")) as stage:
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
                if result.permission == "granted" and parsed(result.attack)[1] == LEVEL:
                    granted = item
            if granted is not None and set(LEDGER_ATTACKS) & set(names or LEDGER_ATTACKS):
                status.update("Attacking the ledger")
                for result in await attack_ledger(stage, granted):
                    note(result)
    if report is not None:
        for path in write(results, report):
            console.print(f"Wrote {path}")
    if not as_json:
        console.print(_table(results))
        console.print(f"{time.monotonic() - started:.0f} s; every outcome is a committed transaction.")
    return 0 if all(result.as_documented for result in results) else 1


def _came_to_nothing(name: str, item: CommittedVerdict) -> bool:
    """Whether a verdict says nothing about the attack, only about the radio, the witness or a crowded machine.

    Who may be granted asks again as long as it is left open, as a pilot does.
    """
    attack, level = parsed(name)
    if item.verdict.outcome != "inconclusive" or attack in UNANSWERED:
        return False
    if may_be_granted(attack, level):
        return True
    codes = {reason.code for reason in item.verdict.reasons}
    return not NOTHING_HEARD.isdisjoint(codes) and "witness_contradicts" not in codes


def _silent(waiting: Sequence[str]) -> ProcessError:
    return ProcessError(f"no verdict for {PATIENCE_S:.0f} s; still without one: {', '.join(waiting)}")


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
        raise _silent(waiting) from None
    finally:
        if not pending.done():
            pending.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await pending
    return pending.result()


def _result(name: str, item: CommittedVerdict, sessions: int, *, as_documented: bool) -> WireResult:
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
        sessions,
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


def write(results: Sequence[WireResult], directory: Path) -> list[Path]:
    """``wire.json`` and ``wire.md``; returns what was written."""
    directory.mkdir(parents=True, exist_ok=True)
    data, table = directory / "wire.json", directory / "wire.md"
    data.write_text(json.dumps([asdict(each) for each in results], indent=1) + "\n")
    table.write_text(markdown(results))
    return [data, table]


def markdown(results: Sequence[WireResult]) -> str:
    """A row for each flight: the sample's part of ``docs/threat-model.md``."""
    lines = [
        "| Attack | Level demanded | Outcome | Permission | Level reached | Rounds | Reasons |",
        "|---|---|---|---|---|---|---|",
    ]
    order = {name: number for number, name in enumerate(specs())}
    for one in sorted(
        results, key=lambda each: (order.get(parsed(each.attack)[0], len(order)), parsed(each.attack)[1])
    ):
        name, level = parsed(one.attack)
        on_ledger = not one.tx_id
        reached, rounds = ("–", "–") if on_ledger else (str(one.assurance), str(one.rounds))
        reasons = ", ".join(f"`{reason}`" for reason in one.reasons)
        lines.append(
            f"| `{name}` | {'–' if on_ledger else level} | {one.outcome} | {one.permission} | {reached} | {rounds} | "
            f"{reasons} |"
        )
    return "\n".join(lines) + "\n"
