"""``wonderland network capacity``: what a proof costs on this channel, counted in its own blocks."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from wonderland.consoles import for_people
from wonderland_fabric_gateway.capacity import MILLION, Census
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_network.console import dir_option, json_option, open_at

if TYPE_CHECKING:
    from wonderland_fabric_network.network import Network

_MEGA = 1e6
_GIGA = 1e9


@click.command()
@dir_option
@click.option("--last", default=10_000, show_default=True, type=click.IntRange(1), help="Look at so many blocks.")
@json_option
def capacity(*, directory: Path, last: int, as_json: bool) -> None:
    """Count transactions and bytes of the last blocks, and say what a proof and a million of them take.

    Bytes are those of blocks as a peer stores them; the peer's state and indexes come on top, and are measured where
    its directory is on this machine. docs/operate/capacity.md tells how to read it.
    """
    made = open_at(directory)
    census = asyncio.run(_census(made, last))
    disk = {member.component: _octets(made.node(member).data) for member in (*made.peers, *made.orderers)}
    if as_json:
        click.echo(json.dumps({**census.as_json(), "disk_bytes": disk}))
        return
    _show(census, disk)


async def _census(network: Network, last: int) -> Census:
    connection = Connection.load(network.directory.connection_file)
    census = Census()
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity("mirror"), connection.signer("mirror"))
        ledger = gateway.network(connection.channel)
        height = await ledger.height()
        first = max(0, height - last)
        async with ledger.blocks(start_block=first) as stream:
            async for block in stream:
                census.count([block])
                if block.number >= height - 1:
                    break
    return census


def _octets(directory: Path) -> int:
    """What the files of a server take on the disk; 0 where it is elsewhere."""
    return sum(path.stat().st_blocks * 512 for path in directory.rglob("*") if path.is_file())


def _show(census: Census, disk: dict[str, int]) -> None:
    console = for_people()
    console.print(
        f"{census.blocks} blocks with {census.transactions} transactions ({census.invalid} invalid), "
        f"{census.octets / _MEGA:.2f} MB"
    )
    table = Table(box=None, pad_edge=False)
    for heading in ("transaction", "count", "bytes each"):
        table.add_column(heading, justify="left" if heading == "transaction" else "right")
    for name, share in sorted(census.functions.items(), key=lambda item: -item[1].count):
        if share.count:
            table.add_row(name, str(share.count), f"{share.mean:,.0f}")
    console.print(table)
    proof = census.proof()
    if proof is None:
        console.print("There is no proof among them yet.")
    else:
        console.print(
            f"\na proof   {proof.transactions:.2f} transactions, {proof.octets / 1000:.1f} kB of them and "
            f"{proof.overhead / 1000:.1f} kB of blocks around them"
        )
        console.print(
            f"a million {proof.stored * MILLION / _GIGA:.1f} GB of blocks on each peer and each orderer, "
            f"{proof.state * MILLION / _GIGA:.1f} GB of state on each peer"
        )
    for name, octets in disk.items():
        if octets:
            console.print(f"on disk   {name:<24} {octets / _MEGA:,.1f} MB, state and indexes included")
