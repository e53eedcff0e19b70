"""``wonderland world enrol``, ``run`` and ``health``."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console

from wonderland.proof_contract import ProofContract, RefusedError
from wonderland.proofs.records.policies import Policy
from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.settings import load
from wonderland_edge_agent.status_command import is_alive
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_simulator import identities
from wonderland_simulator.practice.reading import Scenario, ScenarioError, read_scenario
from wonderland_simulator.practice.run import run_scenario
from wonderland_simulator.practice.showing import what_to_enter
from wonderland_simulator.practice.writing import write_files
from wonderland_simulator.scenario import DRONES, DWM1001, PADS, DroneSpec, PadSite
from wonderland_simulator.stage import ProcessError, Stage, StageSettings
from wonderland_simulator.stage.registry import Registry
from wonderland_simulator.stage.stage import default_policy
from wonderland_uav_agent.position.source import PositionError

_directory = click.Path(file_okay=False, path_type=Path)
WATCH_S = 0.5
NOT_FOUND = 404


_file = click.Path(exists=True, dir_okay=False, path_type=Path)
_scenario = click.option("--scenario", type=_file, metavar="YAML", help="Your own pads and vehicles, of this file.")


@click.command()
@click.option("--network", "network", type=_directory, help="Directory of a Fabric network (`wonderland network`).")
@click.option("--ledger", "ledger", type=_directory, help="Directory of an embedded ledger (`wonderland ledger`).")
@click.option("--to", "to", required=True, type=_directory, help="Where the identities are written.")
@_scenario
def enrol(*, network: Path | None, ledger: Path | None, to: Path, scenario: Path | None) -> None:
    """Enrol the world's pads and drones; write what the world needs to TO/world, what the backend needs to TO/backend.

    May be run again: who has an identity keeps it.
    """
    if (network is None) == (ledger is None):
        raise click.UsageError("say one of --network and --ledger")
    pads, drones = _who(scenario)
    try:
        if network is not None:
            connection = asyncio.run(identities.enrol_on_fabric(network, pads, drones))
        else:
            assert ledger is not None
            connection = identities.enrol_on_embedded(ledger, pads, drones)
        to.mkdir(parents=True, exist_ok=True, mode=0o700)
        identities.hand_out(connection, to, pads, drones)
    except LedgerError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"{to}: {error.strerror or error}") from error
    click.echo(f"{_counted(pads, drones)} have identities in {to / 'world'}.")


@click.command()
@click.option("--connection", required=True, type=_file, help="connection.json that `enrol` wrote for the world.")
@click.option("--scenario", required=True, type=_file, metavar="YAML", help="Your own pads and vehicles, of this file.")
@click.option("--operator-id", default="practice", show_default=True, help="Who operates the pads.")
def register(*, connection: Path, scenario: Path, operator_id: str) -> None:
    """Put a scenario's pads and vehicles on the ledger, as the people would who may.

    Pads: registered, commissioned as a good survey and calibration would have found them, with a policy. Vehicles:
    registered, maintained, authorised for their pad. A pad that was commissioned already keeps its record: to practise
    commissioning itself, do that first (docs/practise.md).
    """
    pads, drones = _who(scenario)
    try:
        asyncio.run(_register(connection, pads, drones, operator_id))
    except LedgerError as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"{_counted(pads, drones)} are on the ledger.")


def _policy(pad: PadSite) -> Policy:
    """What its boards can bear: with DWM1001 that is nothing that a radio proves."""
    return replace(default_policy(pad), min_assurance=0) if pad.profile == DWM1001 else default_policy(pad)


async def _register(connection: Path, pads: Sequence[PadSite], drones: Sequence[DroneSpec], operator_id: str) -> None:
    known = Connection.load(connection)
    now_ms = time.time_ns() // 1_000_000
    async with known.open_channel() as channel:
        gateway = Gateway(channel, known.identity("pad_operator"), known.signer("pad_operator"))
        contract = ProofContract(gateway.network(known.channel), known.chaincode)
        kept = {pad.pad_id for pad in pads if await _is_commissioned(contract, pad.pad_id)}
        registry = Registry(known, channel, pad_operator=operator_id)
        await registry.pads(
            pads,
            now_ms,
            policy=_policy,
            commissioning=lambda pad: None if pad.pad_id in kept else pad.commissioning(now_ms),
        )
        await registry.drones(drones, now_ms)


async def _is_commissioned(contract: ProofContract, pad_id: str) -> bool:
    try:
        return (await contract.read_pad(pad_id)).commissioning is not None
    except RefusedError as error:
        if error.status == NOT_FOUND:
            return False
        raise


@click.command()
@click.argument("file", type=_file)
def check(*, file: Path) -> None:
    """Say everything that is wrong with a scenario file: line, field, and what is allowed there."""
    scenario = _read(file)
    click.echo(f"{file} is good: {_counted(scenario.pads, scenario.vehicles)}.")
    for line in what_to_enter(scenario):
        click.echo(line)


def _read(file: Path) -> Scenario:
    try:
        return read_scenario(file)
    except ScenarioError as error:
        raise click.ClickException(str(error)) from error


def _counted(pads: Sequence[object], drones: Sequence[object]) -> str:
    counts = ((len(pads), "pad"), (len(drones), "drone"))
    return " and ".join(f"{number} {what}{'' if number == 1 else 's'}" for number, what in counts)


def _who(file: Path | None) -> tuple[Sequence[PadSite], Sequence[DroneSpec]]:
    """The demo's pads and drones, or a file's."""
    if file is None:
        return PADS, DRONES
    scenario = _read(file)
    return [pad.site for pad in scenario.pads], [each.spec for each in scenario.vehicles]


@click.command()
@_scenario
@click.option(
    "--connection",
    type=click.Path(dir_okay=False, path_type=Path),
    help="connection.json that `enrol` wrote for the world. With --scenario: what --write puts into the files.",
)
@click.option("--backend", "backend_url", metavar="URL", help="The backend, for example http://host:8080")
@click.option("--dir", "directory", type=_directory, help="Spools, serial devices and logs of the demo's world.")
@click.option("--seed", type=int, default=1, show_default=True, help="Same seed, same noise; a scenario has its own.")
@click.option("--write", type=_directory, help="With --scenario: write a pad.toml or uav.toml for each, here.")
@click.option("--check", "only_check", is_flag=True, help="With --scenario: say what is wrong with the file, and end.")
@click.option("--json", "as_json", is_flag=True, help="With --scenario: lines of JSON on standard output.")
def run(
    *,
    scenario: Path | None,
    connection: Path | None,
    backend_url: str | None,
    directory: Path | None,
    seed: int,
    write: Path | None,
    only_check: bool,
    as_json: bool,
) -> None:
    """Fly, broadcast and be ranged until told to stop (Ctrl-C or SIGTERM).

    With --scenario: your own pads and vehicles, as ports and datagrams. You start the agents (`wonderland pad run`,
    `wonderland uav prove` or `serve`), against your own ledger and backend.

    Without: the demo's world with its agents; --connection, --backend and --dir are needed then.
    """
    if scenario is None:
        if connection is None or backend_url is None or directory is None:
            raise click.UsageError("say --scenario, or --connection, --backend and --dir for the demo's world")
        if write is not None or only_check or as_json:
            raise click.UsageError("--write, --check and --json go with --scenario")
        try:
            asyncio.run(_run(connection.absolute(), backend_url, directory.absolute(), seed))
        except (ProcessError, LedgerError) as error:
            raise click.ClickException(f"{error}\nLogs are in {directory / 'logs'}") from error
        return
    found = _read(scenario)
    if only_check:
        click.echo(f"{scenario} is good: {_counted(found.pads, found.vehicles)}.")
        return
    try:
        if write is not None:
            told = (connection or Path("connection.json")).absolute()
            for path, written in write_files(found, write.absolute(), told, backend_url or ""):
                text = f"{path} {'is written' if written else 'stays: it says something else than the scenario'}."
                click.echo(text, err=True)
        asyncio.run(run_scenario(found, Console(), as_json=as_json))
    except PositionError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"{error.filename or scenario}: {error.strerror or error}") from error


async def _run(connection: Path, backend_url: str, directory: Path, seed: int) -> None:

    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)

    async def work() -> None:
        settings = StageSettings(PADS, DRONES, connection=connection, backend_url=backend_url)
        async with Stage(directory, settings, say=lambda text: click.echo(f"{text}…", err=True)) as stage:
            await stage.start_world(seed=seed)
            click.echo(json.dumps({"ready": True, "pads": len(PADS), "drones": len(DRONES)}))
            while (ended := stage.processes.ended()) is None:  # noqa: ASYNC110 - children say nothing when they end
                await asyncio.sleep(WATCH_S)
            raise ProcessError(f"{ended.name} ended by itself (code {ended.handle.returncode}).\n{ended.last_words()}")

    working = asyncio.ensure_future(work())
    stopping = asyncio.ensure_future(stop.wait())
    await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
    stopping.cancel()
    if not working.done():
        working.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await working
        return
    working.result()


@click.command()
@click.option("--dir", "directory", required=True, type=_directory, help="What `run` was given.")
def health(*, directory: Path) -> None:
    """Say whether every pad's agent works. Exit code 1 when one does not, or says nothing for half a minute."""
    pads = sorted(directory.glob("pads/*/pad.toml"))
    try:
        silent = [path.parent.name for path in pads if not is_alive(load(path).status_file)]
    except SettingsError as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"{len(pads) - len(silent)} of {len(pads)} pads work{': silent ' + ', '.join(silent) if silent else ''}")
    sys.exit(1 if silent or not pads else 0)
