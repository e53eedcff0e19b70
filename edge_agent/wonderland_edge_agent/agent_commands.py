"""``wonderland pad run``: a pad's agent."""

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
from wonderland_edge_agent.assembly import open_pad
from wonderland_edge_agent.config_option import config_option
from wonderland_edge_agent.ports import AgentError
from wonderland_edge_agent.receiver.settings import trust
from wonderland_edge_agent.settings import load


@click.command()
@config_option
@click.option("--json", "as_json", is_flag=True, help="One JSON line when the pad is ready, instead of text.")
@click.option("--check", is_flag=True, help="Read the settings, say which Remote ID sources can be trusted, and end.")
@click.option("-v", "--verbose", is_flag=True, help="Say more in the log.")
def run(*, path: Path, as_json: bool, check: bool, verbose: bool) -> None:
    """Work until told to stop (Ctrl-C or SIGTERM); what is under way then ends in a recorded state."""
    if check:
        _check(path)
        return
    set_up_log(logging.DEBUG if verbose else logging.INFO)
    logging.getLogger("websockets").setLevel(logging.WARNING)
    try:
        asyncio.run(_run(path, as_json=as_json))
    except (SettingsError, AgentError) as error:
        raise click.ClickException(str(error)) from error


def _check(path: Path) -> None:
    """What the settings say, without opening anything."""
    try:
        settings = load(path)
    except SettingsError as error:
        raise click.ClickException(str(error)) from error
    sources = trust(settings.remote_id)
    click.echo(f"Pad {settings.pad_id}: the settings can be read.")
    channels = ", ".join(map(str, settings.uwb.channels))
    click.echo(
        f"UWB channels: {channels} (region {settings.uwb.region}); a plan of any other is refused."
        if settings.uwb.region
        else f"UWB channels: {channels}; no region is set (uwb.region), so that no plan is refused for its channel."
    )
    click.echo("Remote ID is heard from:" if sources else "No Remote ID is heard: no receiver is set.")
    for source in sources:
        click.echo(f"  {source}")


async def _run(path: Path, *, as_json: bool) -> None:

    settings = load(path)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    manager = ServiceManager()
    async with manager.alive(), open_pad(settings) as agent:
        working = asyncio.create_task(agent.run())
        ready = asyncio.create_task(agent.wait_ready())
        stopping = asyncio.create_task(stop.wait())
        # It works from here on, whatever its anchors do: one that is missing is no reason to start it again.
        manager.tell("READY=1")
        try:
            await asyncio.wait({working, ready, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if ready.done():
                click.echo(
                    json.dumps({"ready": True, "pad_id": settings.pad_id})
                    if as_json
                    else f"Pad {settings.pad_id} is ready. Ctrl-C stops it."
                )
            await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (ready, stopping, working):
                task.cancel()
            outcome = (await asyncio.gather(working, ready, stopping, return_exceptions=True))[0]
    if isinstance(outcome, Exception):
        raise outcome
