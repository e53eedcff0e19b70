"""A drone's agent with all that it needs, from what its commands were told."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from wonderland.clock import Clock, SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs.records.verdicts import Verdict
from wonderland.uwb.layout import WordWays
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer
from wonderland_fira_uci.errors import UwbError
from wonderland_uav_agent.agent import UavAgent, UavAgentError
from wonderland_uav_agent.broadcasts import OpenDroneIdSettings
from wonderland_uav_agent.flight import FlightSettings, Pilot
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.missing import Missing
from wonderland_uav_agent.position.odometry import OdometrySettings
from wonderland_uav_agent.radio import UavRadio
from wonderland_uav_agent.radio.tag import TagRadio
from wonderland_uav_agent.session.ports import Act
from wonderland_uav_agent.session.runner import StepListener
from wonderland_uav_agent.sources import open_broadcasts, open_position, tell_autopilot


@dataclass(frozen=True, slots=True)
class Assembled:
    """The agent, who it is, and what it lacks; ``pilot`` where it flies by permission."""

    agent: UavAgent
    ledger: ProofContract
    identity: Identity
    signer: Signer
    missing: Missing
    pilot: Pilot | None


@contextlib.asynccontextmanager
async def assembled(
    *,
    connection: Path,
    identity: str,
    port: str,
    node: str,
    words: WordWays,
    report_to: str | None,
    board: str | None,
    position: str,
    geoid: Path | None,
    antenna_m: tuple[float, float, float],
    mavlink_key: Path | None,
    remote_id: str | None,
    command: str | None,
    whole_certificate: bool,
    wait_s: float,
    quiet: bool,
    act: Act | None = None,
    stays: bool = False,
    flight: FlightSettings | None = None,
    open_drone_id: OpenDroneIdSettings | None = None,
    interfaces: tuple[Path, ...] = (),
    odometry: OdometrySettings | None = None,
    on_step: StepListener | None = None,
) -> AsyncIterator[Assembled]:
    """The drone's agent with all that it needs. `stays`: does not wait for any of it."""
    if (node != "uci") != (report_to is not None):
        raise click.UsageError("--node dwm1001 or dwm1001-anchor and --report-to HOST:PORT go together")
    if (node == "dwm1001-anchor") != (board is not None):
        raise click.UsageError("--node dwm1001-anchor and --board HEX go together")
    clock = SteadyClock()
    radio = UavRadio(port, clock, words=words) if node == "uci" else _tag(port, report_to, board, clock)
    where = Connection.load(connection)
    who, signer = where.identity(identity), where.signer(identity)
    async with contextlib.AsyncExitStack() as stack:
        channel = await stack.enter_async_context(where.open_channel())
        ledger = ProofContract(Gateway(channel, who, signer).network(where.channel), where.chaincode)
        pilot = None if flight is None else Pilot(flight, clock=clock, antenna_m=antenna_m)
        crew = None if pilot is None else pilot.board
        opened = open_position(
            position,
            clock,
            geoid,
            antenna_m=antenna_m,
            wait=not stays,
            key_file=mavlink_key,
            interfaces=interfaces,
            odometry=odometry,
            crew=crew,
        )
        source = await stack.enter_async_context(opened)
        broadcasts = (
            await stack.enter_async_context(open_broadcasts(remote_id, who.pol_id, clock, source))
            if remote_id
            else None
        )
        if open_drone_id is not None:
            tell_autopilot(open_drone_id, who.pol_id, source)
        await stack.enter_async_context(radio)
        if not stays:  # a request would take the pad's time and one of its keys, for a drone that cannot be ranged
            try:
                await radio.wait_ready()
            except UwbError as error:
                raise UavAgentError("node_away", f"nothing was asked: {error}") from error
        events = await stack.enter_async_context(LedgerEvents(ledger, at_once=not stays))
        agent = UavAgent(
            uav_id=who.pol_id,
            ledger=ledger,
            events=events,
            identity=who,
            signer=signer,
            radio=radio,
            position=source,
            broadcasts=broadcasts,
            act=act or (_act(command) if pilot is None else pilot.act),
            clock=clock,
            whole_certificate=whole_certificate,
            patience_s=wait_s,
            on_step=on_step or (None if quiet else progress),
            on_range=None if pilot is None else pilot.on_range,
        )
        missing = Missing(
            position=lambda: source.why_not(clock()),
            ledger=events.look,
            node=lambda: radio.trouble,
            clock=clock,
        )
        yield Assembled(agent, ledger, who, signer, missing, pilot)


def _tag(port: str, report_to: str | None, board: str | None, clock: Clock) -> TagRadio:
    host, _, number = (report_to or "").rpartition(":")
    if not host or not number.isascii() or not number.isdigit() or not 0 < int(number) < 65_536:
        raise click.UsageError(f"--report-to {report_to}: give HOST:PORT")
    try:
        address = None if board is None else int(board, 16)
    except ValueError:
        address = -1
    if address is not None and not 0 <= address <= 0xFFFF:
        raise click.UsageError(f"--board {board}: give up to four hexadecimal digits, as its shell says (si)")
    return TagRadio(port, (host.strip("[]"), int(number)), clock, board=address)


def _act(command: str | None) -> Act:
    """What a permission sets off: the given program, or nothing but the word that it is done."""

    async def act(verdict: Verdict) -> str:
        if command is None:
            return "done"
        try:
            process = await asyncio.create_subprocess_exec(
                command, verdict.action, verdict.session_id, stdin=asyncio.subprocess.DEVNULL
            )
        except OSError as error:
            return f"{command} cannot be run: {error.strerror or error}"
        try:
            status = await process.wait()
        except asyncio.CancelledError:
            process.terminate()
            raise
        return "done" if status == 0 else f"{command} ended with status {status}"

    return act


def progress(_session: object, report: Any) -> None:
    """A step of a proof, for people."""
    mark = "✓" if report.ok else "✗"
    click.echo(f"  {mark} {report.step:<11}{report.detail}", err=True)
