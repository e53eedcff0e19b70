"""``wonderland uav prove``, ``calibrate`` and ``serve``: proofs from the drone's companion computer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import click

from wonderland import messages
from wonderland.clock import Clock, SteadyClock
from wonderland.log_lines import set_up_log
from wonderland.proof_contract import MAX_NOTE, ProofContract
from wonderland.proofs.records.fields import ACTIONS
from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland.proofs.records.verdicts import Verdict
from wonderland.telemetry import Credentials, clean, tls_of
from wonderland.uwb.layout import WordWays
from wonderland.uwb.port_options import PORT
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer
from wonderland_uav_agent.agent import ProofResult, UavAgent, UavAgentError
from wonderland_uav_agent.broadcasts import BroadcastError, RemoteIdModule
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.missing import Missing
from wonderland_uav_agent.position import AutopilotPosition, PositionError, TellingPosition, TrackPosition
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress, parse_address
from wonderland_uav_agent.position.mavlink.address import FORMS
from wonderland_uav_agent.radio import UavRadio
from wonderland_uav_agent.radio.tag import TagRadio
from wonderland_uav_agent.requests import Requests
from wonderland_uav_agent.session.ports import Act
from wonderland_uav_agent.willing import Willing

POSITION_PATIENCE_S = 10.0
_ENDS: Final = "console/end"
LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})


def _of_the_drone(command: Callable[..., None]) -> Callable[..., None]:
    """The options that say which drone this is, and what it has."""
    options = (
        click.option(
            "--connection", required=True, type=click.Path(path_type=Path), help="connection.json of the ledger."
        ),
        click.option("--identity", default="uav", show_default=True, help="A name in connection.json."),
        click.option(
            "--port",
            required=True,
            type=PORT,
            help="Port of the drone's UWB node: a device, socket://HOST:PORT or rfc2217://HOST:PORT.",
        ),
        click.option(
            "--node",
            type=click.Choice(("uci", "dwm1001", "dwm1001-anchor")),
            default="uci",
            show_default=True,
            help="What hangs there. With a DWM1001 tag the drone reports its own ranges, with an anchor the pad's tags "
            "measure it: assurance 0 with either.",
        ),
        click.option("--board", metavar="HEX", help="Short address of the anchor on the drone (dwm1001-anchor)."),
        click.option(
            "--words",
            type=click.Choice(("both_ways", "initiator")),
            default="both_ways",
            show_default=True,
            help="UCI: who carries data in a ranging session. No node says whether it does so as a responder, too.",
        ),
        click.option(
            "--report-to", metavar="HOST:PORT", help="Where the pad listens to drones with a DWM1001 (its uwb.listen)."
        ),
        click.option(
            "--position",
            required=True,
            metavar="mavlink:…|udp:HOST:PORT|track:FILE",
            help="Where the drone's position comes from: an autopilot that speaks MAVLink (mavlink:udp:HOST:PORT, "
            "mavlink:tcp:HOST:PORT, mavlink:serial:DEVICE[:BAUD]), JSON datagrams, or a recorded track (CSV).",
        ),
        click.option(
            "--remote-id",
            metavar="udp:HOST:PORT",
            help="Where the drone's Remote ID module says what it broadcasts; the agent signs for that, so that no "
            "impostor's broadcast is taken for the drone's. Listen on this machine alone (127.0.0.1).",
        ),
        click.option(
            "--then",
            "command",
            metavar="PROGRAM",
            help="Run with the action and the session's id once it is permitted; exit status 0 means done.",
        ),
        click.option("--whole-certificate", is_flag=True, help="Say the whole certificate over UWB, not its hash."),
        click.option("-v", "--verbose", is_flag=True, help="Say more in the log."),
    )
    for option in reversed(options):
        command = option(command)
    return command


@click.command()
@_of_the_drone
@click.option("--pad", "pad_id", required=True, help="The landing pad.")
@click.option("--action", type=click.Choice(ACTIONS), default="land", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="One JSON document with the result.")
def prove(*, as_json: bool, verbose: bool, **options: Any) -> None:
    """Prove where the drone is. Exit code 0 when permitted and done, 2 when refused, 1 when no proof came about."""
    _log_to_stderr(verbose=verbose)
    try:
        result = asyncio.run(_prove(**options, quiet=as_json))
    except (LedgerError, UavAgentError, PositionError, BroadcastError) as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps(_document(result)))
    else:
        _show(result)
    sys.exit(0 if (result.state, result.end) == ("completed", "done") else 2)


def _log_to_stderr(*, verbose: bool) -> None:
    set_up_log(logging.DEBUG if verbose else logging.WARNING)


async def _prove(*, pad_id: str, action: str, **options: Any) -> ProofResult:
    async with _agent(**options) as (agent, *_):
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, agent.stop)
        return await agent.prove(pad_id, action)


@click.command()
@_of_the_drone
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
        results = asyncio.run(_ranged(pad_id, sessions, **options))
    except (LedgerError, UavAgentError, PositionError, BroadcastError) as error:
        raise click.ClickException(str(error)) from error
    for result in results:
        _show(result)
    unfinished = sum(result.verdict is None for result in results)
    if unfinished:
        raise click.ClickException(f"{unfinished} of {sessions} sessions brought no ranges; ask again")


async def _ranged(pad_id: str, sessions: int, **options: Any) -> list[ProofResult]:
    async with _agent(command=None, act=_only_ranged, quiet=False, **options) as (agent, *_):
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, agent.stop)
        return [await agent.prove(pad_id, "land") for _ in range(sessions)]


async def _only_ranged(_: Verdict) -> str:
    return "ranged for a calibration: nothing was flown"


@click.command()
@_of_the_drone
@click.option("--backend", "url", required=True, metavar="WSS_URL", help="wss://host/ingest of the backend.")
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
def serve(
    *, url: str, tls_ca: Path | None, pads: tuple[str, ...], network_id: bool, verbose: bool, **options: Any
) -> None:
    """Stay, and prove where the drone is when the authority or its operator asks (POST /api/v1/proof-requests)."""
    _log_to_stderr(verbose=verbose)
    address = urlsplit(url)
    if address.scheme != "wss" and (address.scheme, address.hostname) not in {("ws", "127.0.0.1"), ("ws", "localhost")}:
        raise click.UsageError("--backend: wss:// (ws:// to this machine alone)")
    try:
        asyncio.run(_serve(url, frozenset(pads), network_id=network_id, tls_ca=tls_ca, **options, quiet=False))
    except (LedgerError, PositionError, BroadcastError) as error:
        raise click.ClickException(str(error)) from error


async def _serve(
    url: str, pads: frozenset[str], *, network_id: bool, tls_ca: Path | None, identity: str, **options: Any
) -> None:
    tls = None
    if urlsplit(url).scheme == "wss":
        shown = Connection.load(options["connection"]).client_files(identity)
        try:
            tls = tls_of(tls_ca, shown)
        except OSError as cause:  # ssl.SSLError is one
            raise click.UsageError(f"--backend-ca {tls_ca}: no certificate authority ({cause})") from cause
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopping.set)
    async with _agent(identity=identity, stays=True, **options) as (agent, (who, signer), missing):
        willing = Willing(agent, pads, missing.why_not)
        position = agent.position if network_id else None
        credentials = Credentials.of("uav", agent.uav_id, who, signer)
        requests = Requests(url, credentials, willing.decide, position, tls=tls)
        working = [asyncio.create_task(requests.run()), asyncio.create_task(missing.run())]
        told = asyncio.create_task(stopping.wait())
        await asyncio.wait({*working, told}, return_when=asyncio.FIRST_COMPLETED)
        failed = [each for each in working if each.done()]
        for task in (*working, told):
            task.cancel()
        await asyncio.gather(*working, told, return_exceptions=True)
        await willing.stop()
        for task in failed:
            task.result()


@contextlib.asynccontextmanager
async def _agent(
    *,
    connection: Path,
    identity: str,
    port: str,
    node: str,
    words: WordWays,
    report_to: str | None,
    board: str | None,
    position: str,
    remote_id: str | None,
    command: str | None,
    whole_certificate: bool,
    quiet: bool,
    act: Act | None = None,
    stays: bool = False,
) -> AsyncIterator[tuple[UavAgent, tuple[Identity, Signer], Missing]]:
    """The drone's agent with all that it needs, who it is, and what it lacks. `stays`: does not wait for any of it."""
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
        source = await stack.enter_async_context(_position(position, clock, wait=not stays))
        broadcasts = await stack.enter_async_context(_broadcasts(remote_id, who.pol_id, clock)) if remote_id else None
        await stack.enter_async_context(radio)
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
            act=act or _act(command),
            clock=clock,
            whole_certificate=whole_certificate,
            on_step=None if quiet else _progress,
        )
        missing = Missing(
            position=lambda: source.why_not(clock()),
            ledger=events.look,
            node=lambda: radio.trouble,
            clock=clock,
        )
        yield agent, (who, signer), missing


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


@contextlib.asynccontextmanager
async def _position(text: str, clock: Clock, *, wait: bool) -> AsyncIterator[TellingPosition]:

    kind, _, rest = text.partition(":")
    if kind == "mavlink":
        async with _autopilot(rest, clock) as autopilot:
            if wait:
                await autopilot.wait(POSITION_PATIENCE_S)
            yield autopilot
        return
    if kind == "track" and rest:
        yield TrackPosition.load(Path(rest), clock())
        return
    listen = _udp(text)
    if listen is None:
        raise PositionError(f"--position {text}: give {FORMS}, udp:HOST:PORT or track:FILE")
    async with AutopilotPosition(listen, clock) as source:
        if wait:
            await source.wait(POSITION_PATIENCE_S)
        yield source


def _autopilot(text: str, clock: Clock) -> MavlinkPosition:
    where = parse_address(text)
    if isinstance(where, UdpAddress) and where.host not in LOOPBACK:
        click.echo(
            f"--position {where}: whoever reaches this address can say where the drone is; use 127.0.0.1, or a network "
            "that nobody else is in",
            err=True,
        )
    return MavlinkPosition(where, clock)


def _udp(text: str) -> tuple[str, int] | None:
    """``udp:HOST:PORT``, or None."""
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind != "udp" or not host or not (port.isascii() and port.isdigit()) or int(port) > 0xFFFF:
        return None
    return host, int(port)


def _broadcasts(text: str, uav_id: str, clock: Clock) -> RemoteIdModule:

    listen = _udp(text)
    if listen is None:
        raise BroadcastError(f"--remote-id {text}: give udp:HOST:PORT")
    if listen[0] not in LOOPBACK:
        click.echo(
            f"--remote-id {text}: whoever reaches this address has the drone sign for what he sends; use 127.0.0.1",
            err=True,
        )
    return RemoteIdModule(listen, uav_id, clock)


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


def _progress(_session: object, report: Any) -> None:
    mark = "✓" if report.ok else "✗"
    click.echo(f"  {mark} {report.step:<11}{report.detail}", err=True)


def _document(result: ProofResult) -> dict[str, Any]:
    return {
        "session_id": result.session_id,
        "uav_id": result.uav_id,
        "pad_id": result.pad_id,
        "action": result.action,
        "state": result.state,
        "end": result.end,
        "detail": result.detail,
        "outcome": result.verdict.outcome if result.verdict is not None else None,
        "permission": result.verdict.permission if result.verdict is not None else None,
        "verdict": result.verdict.to_json() if result.verdict is not None else None,
        "verdict_tx": result.verdict_tx,
        "closing_tx": result.closing_tx,
        "steps": [{"step": step, "t_ms": result.steps[step]} for step in STEP_NAMES if step in result.steps],
    }


def _show(result: ProofResult) -> None:
    verdict = result.verdict
    if verdict is None:
        click.echo(_no_verdict(result))
        return
    outcome = f"{verdict.outcome.capitalize()} with assurance {verdict.assurance}"
    click.echo(f"{outcome}, permission {verdict.permission} (session {result.session_id[:12]}…)")
    for reason in verdict.reasons:
        click.echo(f"  {messages.text('reasons', reason.code, reason.facts)}")


def _no_verdict(result: ProofResult) -> str:
    """Why there is none: the catalogue's words for the end, and what whoever ended it wrote beside it."""
    known = result.end in messages.keys_of(_ENDS)
    words = messages.text(_ENDS, result.end, {}) if known else result.end.replace("_", " ")
    detail = clean(result.detail, MAX_NOTE).rstrip(".")
    return f"No verdict: {words}." + (f" {detail[:1].upper()}{detail[1:]}." if detail else "")
