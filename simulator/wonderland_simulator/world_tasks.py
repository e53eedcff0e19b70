"""``wonderland world enrol``, ``run`` and ``health``."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
from pathlib import Path

import click

from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.settings import load
from wonderland_edge_agent.status_command import is_alive
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_simulator import identities
from wonderland_simulator.scenario import DRONES, PADS
from wonderland_simulator.stage import ProcessError, Stage, StageSettings

_directory = click.Path(file_okay=False, path_type=Path)
WATCH_S = 0.5


@click.command()
@click.option("--network", "network", type=_directory, help="Directory of a Fabric network (`wonderland network`).")
@click.option("--ledger", "ledger", type=_directory, help="Directory of an embedded ledger (`wonderland ledger`).")
@click.option("--to", "to", required=True, type=_directory, help="Where the identities are written.")
def enrol(*, network: Path | None, ledger: Path | None, to: Path) -> None:
    """Enrol the world's pads and drones; write what the world needs to TO/world, what the backend needs to TO/backend.

    May be run again: who has an identity keeps it.
    """
    if (network is None) == (ledger is None):
        raise click.UsageError("say one of --network and --ledger")
    try:
        if network is not None:
            connection = asyncio.run(identities.enrol_on_fabric(network, PADS, DRONES))
        else:
            assert ledger is not None
            connection = identities.enrol_on_embedded(ledger, PADS, DRONES)
        to.mkdir(parents=True, exist_ok=True, mode=0o700)
        identities.hand_out(connection, to, PADS, DRONES)
    except LedgerError as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"{len(PADS)} pads and {len(DRONES)} drones have identities in {to / 'world'}.")


@click.command()
@click.option(
    "--connection",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="connection.json that `enrol` wrote for the world.",
)
@click.option(
    "--backend", "backend_url", required=True, metavar="URL", help="The backend, for example http://host:8080"
)
@click.option("--dir", "directory", required=True, type=_directory, help="Spools, serial devices and logs.")
@click.option("--seed", type=int, default=1, show_default=True, help="Same seed, same noise.")
def run(*, connection: Path, backend_url: str, directory: Path, seed: int) -> None:
    """Fly, broadcast and prove until told to stop (Ctrl-C or SIGTERM)."""
    try:
        asyncio.run(_run(connection.absolute(), backend_url, directory.absolute(), seed))
    except (ProcessError, LedgerError) as error:
        raise click.ClickException(f"{error}\nLogs are in {directory / 'logs'}") from error


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
