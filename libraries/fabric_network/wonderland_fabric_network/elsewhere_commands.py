"""``wonderland network prepare | certify | join | export | compose``: networks whose servers something else runs."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Final

import click

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.export import export_identities
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import binaries, bringing_up, compose
from wonderland_fabric_network.console import dir_option, open_at, progress
from wonderland_fabric_network.description import EACH, NetworkDescription
from wonderland_fabric_network.layout import NetworkDirectory

_file = click.option(
    "--file",
    "file",
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    help="The description, network.yaml; without it: three organisations with one peer each.",
)


@click.command()
@dir_option
@_file
def prepare(*, directory: Path, file: Path | None) -> None:
    """Write what CAs need that something else starts: first of three steps.

    \b
    For servers in containers, or as system services on machines of their own (hosts: each):
      wonderland network prepare --file network.yaml   then start the CAs
      wonderland network certify                       then start orderers, peers and contract servers
      wonderland network join                          joins them to the channel, agrees on the contract
    Each may be run again. compose.yaml runs them in this order by itself.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    description = NetworkDescription.load(file).with_hosts(EACH) if file else None
    places = NetworkDirectory(directory)
    places.prepare()
    with places.lock():
        made = bringing_up.new_network(places, description or NetworkDescription().with_hosts(EACH))
        bringing_up.prepare(made)
    click.echo(f"{places.path} has what the CAs of {', '.join(made.msp_ids)} need to start.")


@click.command()
@dir_option
def certify(*, directory: Path) -> None:
    """Have the CAs, which run elsewhere, certify everybody; write what the servers need: second of three steps."""
    made = open_at(directory)
    with made.directory.lock(), progress() as report:
        asyncio.run(bringing_up.BringUp(made, binaries.BY_NAME, report).certify())
    click.echo(f"{made.directory.path} has what orderers, peers and contract servers need to start.")


@click.command()
@dir_option
@click.option("--agree", is_flag=True, help="Agree on the installed contract also where another one is agreed on.")
def join(*, directory: Path, agree: bool) -> None:
    """Join servers that run elsewhere to the channel, and agree on the contract: third of three steps."""
    made = open_at(directory)
    with made.directory.lock(), progress() as report:
        asyncio.run(bringing_up.BringUp(made, binaries.BY_NAME, report).join(agree=agree))
    click.echo(f"Channel {made.channel} and contract {made.description.contract.name} answer.")


@click.command()
@click.argument("names", nargs=-1, required=True)
@dir_option
@click.option("--org", "msp_id", help="By this organisation's own peer, not the authority's.")
@click.option(
    "--to", "target", required=True, type=click.Path(file_okay=False, path_type=Path), help="A new or empty directory."
)
@click.option("--again", is_flag=True, help="Also over an earlier export.")
def export(*, names: tuple[str, ...], directory: Path, msp_id: str | None, target: Path, again: bool) -> None:
    """Write what the machine of NAMES needs to connect: keys, certificates and a connection.json."""
    made = open_at(directory)
    source = made.directory.connection_file
    if msp_id is not None:
        source = made.directory.organisation(made.description.organisation(msp_id).msp_id).connection_file
    export_identities(Connection.load(source), names, target, again=again)
    click.echo(f"Copy {target} to that machine, over a safe way: it holds a private key.")


@click.command("compose")
@_file
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write it there instead of to standard output."
)
def compose_command(*, file: Path | None, out: Path | None) -> None:
    """Print compose.yaml: the whole system in containers, from the same description as a network on this machine.

    \b
      wonderland network compose --file network.yaml --out compose.yaml
      docker compose up
    docs/operate/containers.md tells the rest.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    text = compose.compose_yaml(NetworkDescription.load(file) if file else NetworkDescription())
    if out is None:
        sys.stdout.write(text.decode())
    else:
        write_atomic(out, text, PUBLIC)


COMMANDS: Final = (prepare, certify, join, export, compose_command)
