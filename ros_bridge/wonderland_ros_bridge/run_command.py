"""``wonderland ros1 run``: a bridge as a service."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
from pathlib import Path

import click

from wonderland.log_lines import set_up_log
from wonderland.service_manager import ServiceManager
from wonderland.toml_settings import SettingsError
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_ros_bridge.bridge import opened
from wonderland_ros_bridge.checking import explained
from wonderland_ros_bridge.config_option import config
from wonderland_ros_bridge.errors import BridgeError
from wonderland_ros_bridge.settings import load


@click.command()
@config
@click.option("--json", "as_json", is_flag=True, help="One JSON line when the bridge is ready, instead of text.")
@click.option("--check", is_flag=True, help="Say what the settings mean, open nothing, and end.")
@click.option("-v", "--verbose", is_flag=True, help="Say more in the log.")
def run(*, path: Path, as_json: bool, check: bool, verbose: bool) -> None:
    """Work until told to stop (Ctrl-C or SIGTERM). What is not on the ledger yet waits in the spool."""
    if check:
        try:
            click.echo("\n".join(explained(load(path))))
        except (SettingsError, LedgerError) as error:
            raise click.ClickException(str(error)) from error
        return
    set_up_log(logging.DEBUG if verbose else logging.INFO)
    try:
        asyncio.run(_run(path, as_json=as_json))
    except (SettingsError, BridgeError, LedgerError) as error:
        raise click.ClickException(str(error)) from error


async def _run(path: Path, *, as_json: bool) -> None:
    settings = load(path)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    manager = ServiceManager()
    async with manager.alive(), opened(settings) as bridge:
        working = asyncio.create_task(bridge.run())
        ready = asyncio.create_task(bridge.wait_ready())
        stopping = asyncio.create_task(stop.wait())
        manager.tell("READY=1")  # from here on it works, whatever the master and the ledger do
        try:
            await asyncio.wait({working, ready, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if ready.done():
                click.echo(
                    json.dumps({"ready": True, "bridge": settings.bridge, "node": bridge.node.uri})
                    if as_json
                    else f"Bridge {settings.bridge} is ready. Ctrl-C stops it."
                )
                await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if working.done():
                working.result()
        finally:
            for task in (working, ready, stopping):
                task.cancel()
            await asyncio.gather(working, ready, stopping, return_exceptions=True)
