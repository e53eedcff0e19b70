"""``wonderland ros2 run``: a pad as a node, and topics to the ledger and back, as a service."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Final

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
from wonderland_ros_bridge.checking import choice_in_words, rule_in_words, who_in_words
from wonderland_ros_bridge.errors import BridgeError
from wonderland_ros_bridge.ledger.outbox import Outbox
from wonderland_ros_bridge.ros2.pad_node import PadNode
from wonderland_ros_bridge.ros2.reports import listening
from wonderland_ros_bridge.ros2.settings import Settings, load
from wonderland_ros_bridge.ros2.topics import Topics
from wonderland_ros_bridge.together import run_together

_log = logging.getLogger(__name__)
COMPANY_S: Final = 2.0


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
    """Lines for people. Raises LedgerError for a connection file that says not enough."""
    ros2, pad = settings.ros2, settings.pad
    yield f"It is node {settings.node} in domain {ros2.domain}."
    yield who_in_words(settings.ledger)
    if pad is not None:
        yield f"Pad {pad.pad_id}: its frame is {pad.frame}, within {pad.map_frame}."
        yield f"The pad's agent is heard on {pad.reports} (local_reports in pad.toml)."
        if pad.open_rmf is not None:
            group = "no mutex group" if pad.open_rmf.mutex_group is None else f"mutex group {pad.open_rmf.mutex_group}"
            yield f"For Open-RMF it is door {pad.open_rmf.door or pad.pad_id}, with {group}; only a proof opens it."
    yield f"It meets others at {', '.join(ros2.connect)}."
    if ros2.tls is None:
        yield "It speaks with this machine alone: there are no certificates (ros2.tls)."
    else:
        who = ", ".join(ros2.tls.peers) or "everybody whom this authority vouches for"
        yield f"It speaks with holders of certificates by {ros2.tls.ca}: {who}."
    if settings.has_topics:
        yield f"Up to {settings.max_spool_bytes / 2**20:g} MiB wait for the ledger in {settings.spool}."
    yield from (f"To the ledger: {rule_in_words(each)}" for each in settings.to_ledger)
    yield from (f"From the ledger: {choice_in_words(each)}" for each in settings.from_ledger)
    yield "What peers of ROS say permits nothing."


@contextlib.asynccontextmanager
async def opened(settings: Settings) -> AsyncIterator[list[PadNode | Topics]]:
    """What is set up, ready to run. Raises BridgeError, LedgerError, Ros2Error."""
    where = Connection.load(settings.ledger.connection)
    who, signer = where.identity(settings.ledger.identity), where.signer(settings.ledger.identity)
    async with contextlib.AsyncExitStack() as stack:
        parts: list[PadNode | Topics] = []
        channel = await stack.enter_async_context(where.open_channel())
        ledger = AssetContract(Gateway(channel, who, signer).network(where.channel), where.chaincode)
        outbox = None
        if settings.has_topics and settings.spool is not None and settings.bridge is not None:
            outbox = Outbox(settings.spool, bridge=settings.bridge)
            stack.callback(outbox.close)
        made = Node(settings.node, settings.ros2.link(), domain=settings.ros2.domain)
        node = await stack.enter_async_context(made)
        await stack.enter_async_context(_told_who_is_missing(node, ", ".join(settings.ros2.connect)))
        if settings.pad is not None:
            pad = PadNode(settings.pad, node, ledger, SteadyClock())
            await stack.enter_async_context(listening(settings.pad.reports, pad.report))
            parts.append(pad)
        if outbox is not None:
            parts.append(Topics(settings, node, outbox, ledger, clock=_now_ms, steady=SteadyClock()))
        yield parts


@contextlib.asynccontextmanager
async def _told_who_is_missing(node: Node, where: str) -> AsyncIterator[None]:
    """Inside, the log says once that nobody is reached, and once that somebody is."""

    async def watch() -> None:
        told = False
        while True:
            await asyncio.sleep(COMPANY_S)
            if (missing := not node.meets_somebody()) == told:
                continue
            told = missing
            if missing:
                _log.warning(
                    "no router and no peer of ROS 2 is reached at %s: `wonderland ros2 router`, or ROS’s own", where
                )
            else:
                _log.info("a router or peer of ROS 2 is reached again")

    watching = asyncio.create_task(watch())
    try:
        yield
    finally:
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)


def _now_ms() -> int:
    return time.time_ns() // 1_000_000


async def _placed(parts: list[PadNode | Topics]) -> None:
    for each in parts:
        await each.wait_placed()


async def _run(settings: Settings, *, as_json: bool) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    manager = ServiceManager()
    async with manager.alive(), opened(settings) as parts:
        working = asyncio.create_task(run_together(*(each.run() for each in parts)))
        placed = asyncio.create_task(_placed(parts))
        stopping = asyncio.create_task(stop.wait())
        manager.tell("READY=1")  # from here on it works, whatever the router and the ledger do
        try:
            await asyncio.wait({working, placed, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if placed.done():
                ready = {"ready": True, "node": settings.node}
                click.echo(json.dumps(ready) if as_json else f"Node {settings.node} is there. Ctrl-C stops it.")
                await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if working.done():
                working.result()
        finally:
            for task in (working, placed, stopping):
                task.cancel()
            await asyncio.gather(working, placed, stopping, return_exceptions=True)
