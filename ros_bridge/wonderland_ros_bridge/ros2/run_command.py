"""``wonderland ros2 run``: a pad as a node, as a service."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import click

from wonderland.asset_contract import AssetContract
from wonderland.clock import SteadyClock
from wonderland.log_lines import set_up_log
from wonderland.service_manager import ServiceManager
from wonderland.toml_settings import SettingsError
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_rmw_zenoh.errors import Ros2Error
from wonderland_rmw_zenoh.node import Node
from wonderland_ros_bridge.errors import BridgeError
from wonderland_ros_bridge.ros2.pad_node import PadNode
from wonderland_ros_bridge.ros2.reports import listening
from wonderland_ros_bridge.ros2.settings import Settings, load


@click.command()
@click.option(
    "--config",
    "path",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="ros2.toml.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON line when the node is there, instead of text.")
@click.option("--check", is_flag=True, help="Say what the settings mean, open nothing, and end.")
@click.option("-v", "--verbose", is_flag=True, help="Say more in the log.")
def run(*, path: Path, as_json: bool, check: bool, verbose: bool) -> None:
    """Work until told to stop (Ctrl-C or SIGTERM)."""
    try:
        if check:
            click.echo("\n".join(explained(load(path))))
            return
        set_up_log(logging.DEBUG if verbose else logging.INFO)
        asyncio.run(_run(load(path), as_json=as_json))
    except (SettingsError, BridgeError, LedgerError, Ros2Error) as error:
        raise click.ClickException(str(error)) from error


def explained(settings: Settings) -> Iterator[str]:
    """Lines for people."""
    ros2, pad = settings.ros2, settings.pad
    yield f"Pad {pad.pad_id} is node {pad.node} in domain {ros2.domain}."
    yield f"Its frame is {pad.frame}, within {pad.map_frame}."
    yield f"It meets others at {', '.join(ros2.connect)}."
    if ros2.tls is None:
        yield "It speaks with this machine alone: there are no certificates (ros2.tls)."
    else:
        who = ", ".join(ros2.tls.peers) or "everybody whom this authority vouches for"
        yield f"It speaks with holders of certificates by {ros2.tls.ca}: {who}."
    yield f"The pad's agent is heard on {pad.reports} (local_reports in pad.toml)."
    yield "What peers of ROS say permits nothing."


@contextlib.asynccontextmanager
async def opened(settings: Settings) -> AsyncIterator[PadNode]:
    """A pad's node, ready to run. Raises BridgeError, LedgerError, Ros2Error."""
    where = Connection.load(settings.ledger.connection)
    who, signer = where.identity(settings.ledger.identity), where.signer(settings.ledger.identity)
    async with (
        where.open_channel() as channel,
        Node(settings.pad.node, settings.ros2.link(), domain=settings.ros2.domain) as node,
    ):
        ledger = AssetContract(Gateway(channel, who, signer).network(where.channel), where.chaincode)
        pad = PadNode(settings.pad, node, ledger, SteadyClock())
        async with listening(settings.pad.reports, pad.report):
            yield pad


async def _run(settings: Settings, *, as_json: bool) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    manager = ServiceManager()
    async with manager.alive(), opened(settings) as pad:
        working = asyncio.create_task(pad.run())
        placed = asyncio.create_task(pad.placed.wait())
        stopping = asyncio.create_task(stop.wait())
        manager.tell("READY=1")  # from here on it works, whatever the router and the ledger do
        try:
            await asyncio.wait({working, placed, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if placed.done():
                ready = {"ready": True, "node": settings.pad.node}
                click.echo(json.dumps(ready) if as_json else f"Node {settings.pad.node} is there. Ctrl-C stops it.")
                await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if working.done():
                working.result()
        finally:
            for task in (working, placed, stopping):
                task.cancel()
            await asyncio.gather(working, placed, stopping, return_exceptions=True)
