"""``wonderland uav prove``, ``calibrate`` and ``serve``: proofs from the drone's companion computer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
import sys
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click

from wonderland.clock import SteadyClock
from wonderland.log_lines import set_up_log
from wonderland.proofs.records.fields import ACTIONS
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.service_manager import ServiceManager
from wonderland.telemetry import Credentials, tls_of
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.agent import ProofResult, UavAgentError, Urgency
from wonderland_uav_agent.assembly import assembled, progress
from wonderland_uav_agent.broadcasts import BroadcastError
from wonderland_uav_agent.checking import explained
from wonderland_uav_agent.drone_options import (
    flight_settings,
    odometry_settings,
    of_the_drone,
    open_drone_id_settings,
)
from wonderland_uav_agent.flight import FlightSettings
from wonderland_uav_agent.flight.gates import keep_gates
from wonderland_uav_agent.flight.reports import LandingReports
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.requests import Requests
from wonderland_uav_agent.results import document, lines
from wonderland_uav_agent.ros2_orders import OrdersError, Ros2Orders
from wonderland_uav_agent.session.actions import ReportStep
from wonderland_uav_agent.session.runner import StepListener
from wonderland_uav_agent.willing import Willing


@click.command()
@of_the_drone
@click.option("--pad", "pad_id", required=True, help="The landing pad.")
@click.option("--action", type=click.Choice(ACTIONS), default="land", show_default=True, help="What it asks for.")
@click.option("--priority", type=click.Choice(("low_battery", "emergency")), help="Signed, and on record for good.")
@click.option("--battery", "battery_percent", type=click.IntRange(0, 100), help="Per cent left; low_battery needs it.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document with the result.")
def prove(*, as_json: bool, verbose: bool, priority: str | None, battery_percent: int | None, **options: Any) -> None:
    """Prove where the drone is. Exit code 0 when permitted and done, 2 when refused, 1 when no proof came about."""
    if priority == "low_battery" and battery_percent is None:
        raise click.UsageError("--priority low_battery: say with --battery how much is left")
    _log_to_stderr(verbose=verbose)
    urgency = Urgency(priority, battery_percent)
    try:
        result = asyncio.run(_prove(**options, odometry=odometry_settings(), urgency=urgency, quiet=as_json))
    except (LedgerError, UavAgentError, PositionError, BroadcastError) as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps(document(result)))
    else:
        click.echo("\n".join(lines(result)))
    if (result.state, result.end) == ("completed", "done"):
        sys.exit(0)
    sys.exit(1 if result.verdict is None else 2)


def _log_to_stderr(*, verbose: bool) -> None:
    set_up_log(logging.DEBUG if verbose else logging.WARNING)


async def _prove(*, pad_id: str, action: str, urgency: Urgency, **options: Any) -> ProofResult:
    async with assembled(**options) as made:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, made.agent.stop)
        return await made.agent.prove(pad_id, action, urgency)


@click.command()
@of_the_drone
@click.option("--pad", "pad_id", required=True, help="The landing pad.")
@click.option(
    "--sessions", type=click.IntRange(1, 16), default=4, show_default=True, help="How often to ask at this place."
)
def calibrate(*, pad_id: str, sessions: int, verbose: bool, command: str | None, **options: Any) -> None:
    """Be ranged by a pad whose operator calibrates this drone's node.

    The drone stands on the pad's mark. It asks for proofs as ever, flies nothing that they permit, and says so on the
    ledger. What its node adds to every range is found and registered by the pad's side (`wonderland pad
    calibrate-uav`), never by this one. Again after its node, its antenna or its firmware was changed: and withdraw
    the old calibration in the console then, or let the pad's operator do it.
    """
    if command is not None:
        raise click.UsageError("--then: nothing is done that a calibration's sessions permit")
    _log_to_stderr(verbose=verbose)
    try:
        results = asyncio.run(_ranged(pad_id, sessions, odometry=odometry_settings(), **options))
    except (LedgerError, UavAgentError, PositionError, BroadcastError) as error:
        raise click.ClickException(str(error)) from error
    for result in results:
        click.echo("\n".join(lines(result)))
    unfinished = sum(result.verdict is None for result in results)
    if unfinished:
        raise click.ClickException(f"{unfinished} of {sessions} sessions brought no ranges; ask again")


async def _ranged(pad_id: str, sessions: int, **options: Any) -> list[ProofResult]:
    async with assembled(command=None, act=_only_ranged, quiet=False, **options) as made:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, made.agent.stop)
        return [await made.agent.prove(pad_id, "land") for _ in range(sessions)]


async def _only_ranged(_: Verdict) -> str:
    return "ranged for a calibration: nothing was flown"


@click.command()
@of_the_drone
@click.option("--backend", "url", metavar="WSS_URL", help="wss://host/ingest of the backend, which passes on requests.")
@click.option(
    "--backend-ca",
    "tls_ca",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Certificate authority (PEM) of the backend, where it is not a public one.",
)
@click.option(
    "--pad", "pads", multiple=True, required=True, help="A pad at which it will prove itself when asked; several times."
)
@click.option("--network-id", is_flag=True, help="Tell the backend each second where the drone is (Network Remote ID).")
@click.option(
    "--orders",
    metavar="ros2[:tcp/127.0.0.1:PORT]",
    help="Take orders for proofs from ROS 2, too, by rmw_zenoh and this machine's router (action ProveLocation).",
)
@click.option("--check", is_flag=True, help="Say what the settings mean, open nothing, and end.")
def serve(
    *,
    url: str | None,
    tls_ca: Path | None,
    pads: tuple[str, ...],
    network_id: bool,
    orders: str | None,
    check: bool,
    verbose: bool,
    identity: str,
    **options: Any,
) -> None:
    """Stay, and prove where the drone is when the authority or its operator asks (POST /api/v1/proof-requests)."""
    _log_to_stderr(verbose=verbose)
    if url is None and network_id:
        raise click.UsageError("--network-id: needs --backend, which is told")
    address = urlsplit(url or "ws://127.0.0.1")
    if address.scheme != "wss" and (address.scheme, address.hostname) not in {("ws", "127.0.0.1"), ("ws", "localhost")}:
        raise click.UsageError("--backend: wss:// (ws:// to this machine alone)")
    try:
        flight, broadcast, odometry = flight_settings(), open_drone_id_settings(), odometry_settings()
        if url is None and orders is None and flight is None:
            raise click.UsageError("--backend, --orders or [flight] in --config: who or what asks for proofs?")
        named = frozenset(pads)
        if check:
            told = options | {"odometry": odometry, "orders": orders}
            click.echo("\n".join(explained(url, named, identity, flight, told, broadcast)))
            return
        more = {"identity": identity, "flight": flight, "open_drone_id": broadcast, "quiet": False, **options}
        more |= {"odometry": odometry, "orders": orders}
        asyncio.run(_serve(url, named, network_id=network_id, tls_ca=tls_ca, **more))
    except (LedgerError, PositionError, BroadcastError, OrdersError) as error:
        raise click.ClickException(str(error)) from error


async def _serve(
    url: str | None,
    pads: frozenset[str],
    *,
    network_id: bool,
    tls_ca: Path | None,
    orders: str | None,
    identity: str,
    flight: FlightSettings | None,
    **options: Any,
) -> None:
    tls = None
    if url is not None and urlsplit(url).scheme == "wss":
        shown = Connection.load(options["connection"]).client_files(identity)
        try:
            tls = tls_of(tls_ca, shown)
        except OSError as cause:  # ssl.SSLError is one
            raise click.UsageError(f"--backend-ca {tls_ca}: no certificate authority ({cause})") from cause
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopping.set)
    listeners: list[StepListener] = [progress]

    def step(session: Session, report: ReportStep) -> None:
        for each in listeners:
            each(session, report)

    async with contextlib.AsyncExitStack() as stack:
        made = await stack.enter_async_context(
            assembled(identity=identity, stays=True, flight=flight, on_step=step, **options)
        )
        agent = made.agent
        willing = Willing(agent, pads, made.missing.why_not)
        taken = None if orders is None else Ros2Orders(orders, agent.uav_id, willing, SteadyClock())
        if taken is not None:
            await stack.enter_async_context(taken)
            listeners.append(taken.step)
        working = [asyncio.create_task(made.missing.run())]
        if url is not None:
            position = agent.position if network_id else None
            credentials = Credentials.of("uav", agent.uav_id, made.identity, made.signer)
            requests = Requests(url, credentials, willing.decide, position, tls=tls)
            working.append(asyncio.create_task(requests.run()))
        if taken is not None:
            working.append(asyncio.create_task(taken.run()))
        if made.pilot is not None:
            reports = LandingReports(made.ledger)
            made.pilot.prove_with(willing.begin)
            made.pilot.report_with(reports.add)
            working.append(asyncio.create_task(reports.run()))
            working.append(asyncio.create_task(keep_gates(made.pilot.gatekeeper, made.ledger, pads)))
        told = asyncio.create_task(stopping.wait())
        manager = ServiceManager()
        manager.tell("READY=1")
        async with manager.alive():
            await asyncio.wait({*working, told}, return_when=asyncio.FIRST_COMPLETED)
        failed = [each for each in working if each.done()]
        for task in (*working, told):
            task.cancel()
        await asyncio.gather(*working, told, return_exceptions=True)
        await willing.stop()
        for task in failed:
            task.result()
