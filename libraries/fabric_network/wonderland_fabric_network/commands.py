"""``wonderland network``: a real Hyperledger Fabric network on this machine, from one description."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any, Final

import click
from rich.table import Table

from wonderland.consoles import for_people
from wonderland_fabric_gateway.embedded.organisations import ROLES
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import binaries as servers
from wonderland_fabric_network import (
    bringing_up,
    change_commands,
    elsewhere_commands,
    enrolment,
    founding_commands,
    keeping,
    renewal,
    revocations,
    taking_down,
)
from wonderland_fabric_network.capacity_command import capacity
from wonderland_fabric_network.console import dir_option, json_option, open_at, progress
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.invite_command import admit, invite
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.status import NetworkStatus, network_status

_FOLLOW_S: Final = 0.3


class _Group(click.Group):
    """Every error of the network's own ends as its text and exit code 1, never as a stack trace."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except LedgerError as error:
            raise click.ClickException(str(error)) from error


@click.group(cls=_Group)
def network() -> None:
    """Run a Hyperledger Fabric network on this machine.

    \b
    A first try (peer, orderer and fabric-ca-server in FABRIC_BIN or on PATH):
      wonderland network up
      wonderland network status
      wonderland network enrol pad-7 --role pad
      wonderland network down

    Clients take DIR/connection.json, or one organisation's own. docs/operate/network.md tells the rest.
    """  # noqa: D301 - \b is click's mark for "do not wrap"


for each in (
    *elsewhere_commands.COMMANDS,
    *founding_commands.COMMANDS,
    *change_commands.COMMANDS,
    capacity,
    invite,
    admit,
):
    network.add_command(each)


@network.command()
@dir_option
@click.option(
    "--file",
    "file",
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    help="The description, network.yaml; without it: three organisations with one peer each.",
)
@click.option("--consensus", type=click.Choice(["raft", "bft"]), help="How the orderers agree (first time).")
@click.option("--orderers", type=click.IntRange(1, 20), help="How many orderers (first time).")
@json_option
def up(*, directory: Path, file: Path | None, consensus: str | None, orderers: int | None, as_json: bool) -> None:
    """Bring the network up, from nothing or from wherever it stopped. It goes on running when this command ends."""
    begin = time.monotonic()
    description = NetworkDescription.load(file) if file else None
    if consensus or orderers:
        description = (description or NetworkDescription()).with_ordering(consensus, orderers)
    servers.find_binaries()  # before anything is written
    places = NetworkDirectory(directory)
    places.prepare()
    with places.lock(), progress(quiet=as_json) as report:
        made = bringing_up.new_network(places, description)

        async def run() -> None:
            await bringing_up.bring_up(made, await servers.check_binaries(), report)

        asyncio.run(run())
    seconds = time.monotonic() - begin
    if as_json:
        click.echo(
            json.dumps(
                {
                    "ready": True,
                    "connection": str(places.connection_file),
                    "connections": {
                        each.msp_id: str(places.organisation(each.msp_id).connection_file)
                        for each in made.organisations
                    },
                    "channel": made.channel,
                    "chaincode": made.description.contract.name,
                    "seconds": round(seconds, 2),
                }
            )
        )
        return
    click.echo(
        f"\nnetwork  up after {seconds:.1f} s: channel {made.channel}, contract {made.description.contract.name}"
    )
    click.echo(f"connect  {places.connection_file}")
    click.echo("`wonderland network down` stops it.")


@network.command()
@dir_option
def keep(*, directory: Path) -> None:
    """Bring up again whatever of a running network ends by itself, until this is stopped (Ctrl-C, SIGTERM).

    The network goes on running then. For a system service: `network up`, then `network keep`.
    """
    places = NetworkDirectory(directory)

    async def run() -> None:
        stop = asyncio.Event()
        for each in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(each, stop.set)
        await keeping.keep_up(places, await servers.check_binaries(), lambda _step, text: click.echo(text), stop)

    asyncio.run(run())


@network.command()
@dir_option
@json_option
@click.option(
    "--metrics",
    "metrics",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Also write it there for Prometheus (node exporter's textfile collector; a name that ends in .prom).",
)
def status(*, directory: Path, as_json: bool, metrics: Path | None) -> None:
    """Say what runs, how high the chain is, who leads, which contract, and which certificates end soon.

    Exit code 0 when everything runs and answers, 3 otherwise.
    """
    found = asyncio.run(network_status(open_at(directory)))
    if metrics is not None:
        write_atomic(metrics, found.exposition(), PUBLIC)
    if as_json:
        click.echo(json.dumps(found.as_json()))
    else:
        _show(found)
    if not found.healthy:
        sys.exit(3)


@network.command()
@click.argument("component", required=False)
@dir_option
@click.option("-n", "--lines", default=20, show_default=True, type=click.IntRange(1, 100_000), help="How many lines.")
@click.option("-f", "--follow", is_flag=True, help="Go on showing what is added (one component).")
@click.option("--shorten", is_flag=True, help="Put aside logs of more than 64 MiB (NAME.log.1) and begin new ones.")
def logs(*, component: str | None, directory: Path, lines: int, follow: bool, shorten: bool) -> None:
    """Show the end of what COMPONENT wrote (PadMSP.peer0, OrdererMSP.orderer0, PadMSP.ca, …), or of all."""
    processes = open_at(directory).processes
    names = processes.names()
    if shorten:
        done = processes.shorten_logs()
        click.echo(f"begun anew: {', '.join(done)}" if done else "no log is longer than 64 MiB")
        return
    if component is None:
        for name in names:
            click.secho(f"{name}  {processes.log(name)}", bold=True)
            click.echo(processes.tail(name, min(lines, 5)))
        return
    if component not in names:
        raise click.ClickException(f"there is no component {component!r}; there are: {', '.join(names) or 'none yet'}")
    click.echo(processes.tail(component, lines))
    if follow:
        with contextlib.suppress(KeyboardInterrupt):
            _follow(processes.log(component))


@network.command()
@dir_option
def down(*, directory: Path) -> None:
    """Stop everything. The ledgers stay; `up` goes on from there."""
    made = open_at(directory)
    with made.directory.lock(), progress() as report:
        asyncio.run(taking_down.take_down(made, report))
    click.echo("The network is down.")


@network.command()
@dir_option
@click.option("--yes", is_flag=True, help="Do not ask.")
def destroy(*, directory: Path, yes: bool) -> None:
    """Stop everything and remove it: keys, certificates and ledgers. This cannot be undone."""
    made = open_at(directory)
    if not yes:
        click.confirm(f"Remove all keys, certificates and ledgers in {made.directory.path}?", abort=True)
    with made.directory.lock(), progress() as report:
        asyncio.run(taking_down.take_down(made, report))
        taking_down.destroy(made)
    click.echo(f"{made.directory.path} is gone.")


@network.command()
@click.argument("name")
@dir_option
@click.option("--role", required=True, type=click.Choice(tuple(ROLES)), help="What it may do (pol.role).")
@click.option("--id", "pol_id", default="", help="Registry id of the pad or drone (pol.id); the name unless given.")
@click.option("--org", "msp_id", help="The organisation, where several of its kind give out the role.")
@json_option
def enrol(*, name: str, directory: Path, role: str, pol_id: str, msp_id: str | None, as_json: bool) -> None:
    """Give NAME a key and a certificate, and add it to the connection files."""
    made = open_at(directory)
    request = enrolment.Request(name, role, pol_id or name, msp_id)
    with made.directory.lock():
        (enrolled,) = asyncio.run(enrolment.enrol(made, [request]))
    if as_json:
        click.echo(json.dumps(enrolled.as_json()))
        return
    click.echo(f"{name} of {enrolled.msp_id}, serial {enrolled.serial}, valid until {enrolled.valid_until}")
    click.echo(f"certificate  {enrolled.certificate}")
    click.echo(f"key          {enrolled.key}")


@network.command()
@click.argument("name", required=False)
@dir_option
@click.option("--serial", default="", help="Revoke this one certificate (hexadecimal serial number), not a whole name.")
@click.option("--crl", type=click.Path(dir_okay=False, exists=True, path_type=Path), help="A list that the CA made.")
@click.option("--org", "msp_id", help="The organisation; needed only where the name does not tell.")
@click.option("--reason", default="unspecified", show_default=True, help="Reason code of RFC 5280, e.g. keyCompromise.")
@json_option
def revoke(
    *, name: str | None, directory: Path, serial: str, crl: Path | None, msp_id: str | None, reason: str, as_json: bool
) -> None:
    """Revoke all certificates of NAME, at its CA and on the channel. It can never enrol under that name again."""
    made = open_at(directory)
    if sum((name is not None, bool(serial), crl is not None)) != 1:
        raise click.UsageError("say one of: a name, --serial, --crl")
    home = msp_id or (made.home_of(name) if name is not None else None)
    if home is None:
        raise click.UsageError("say the organisation with --org")
    with made.directory.lock():
        if crl is not None:
            block = asyncio.run(revocations.set_revocation_list(made, home, crl.read_bytes()))
            done = revocations.Revocation(home, (), block)
        else:
            done = asyncio.run(revocations.revoke(made, home, name=name or "", serial=serial, reason=reason))
    if as_json:
        click.echo(json.dumps(done.as_json()))
        return
    for each in done.serials:
        click.echo(f"revoked  serial {each} of {home}")
    since = "already" if done.block is None else f"since block {done.block}"
    click.echo(f"The channel refuses it {since}." if done.serials else f"The list of {home} holds {since}.")


@network.command()
@click.argument("name", required=False, default="")
@dir_option
@click.option("--org", "msp_id", help="Only this organisation's.")
@click.option(
    "--days",
    default=renewal.DEFAULT_DAYS,
    show_default=True,
    type=click.IntRange(0, 1825),
    help="Those that end within so many days.",
)
@click.option("--all", "everything", is_flag=True, help="All of them, however long they would hold.")
@json_option
def renew(*, name: str, directory: Path, msp_id: str | None, days: int, everything: bool, as_json: bool) -> None:
    """Renew the certificates that end soon, or those of NAME; servers are restarted one at a time."""
    made = open_at(directory)
    wanted = renewal.Wanted(days, everything, name)
    with made.directory.lock(), progress(quiet=as_json) as report:
        made.processes.shorten_logs()

        async def run() -> list[str]:
            return await renewal.renew(made, await servers.check_binaries(), wanted, report, msp_id=msp_id)

        done = asyncio.run(run())
    if as_json:
        click.echo(json.dumps({"renewed": done}))
        return
    click.echo(f"{len(done)} certificates renewed" if done else "nothing to renew")


def _show(found: NetworkStatus) -> None:
    console = for_people()
    table = Table(box=None, pad_edge=False)
    for heading in ("component", "process", "address", "height", "state"):
        table.add_column(heading, no_wrap=heading != "state", overflow="fold")
    for each in found.components:
        state = each.trouble or " ".join(
            part for part in (each.state, "leader" if each.leader else "", each.contract or "") if part
        )
        table.add_row(
            each.name,
            "elsewhere" if found.elsewhere else "[red]down[/red]" if each.pid is None else str(each.pid),
            each.address,
            "" if each.height is None else str(each.height),
            f"[red]{state}[/red]" if each.trouble else state,
        )
    console.print(f"channel {found.channel}, {found.consensus}", highlight=False)
    console.print(table)
    soon = [each for each in found.certificates if each.soon]
    if soon:
        console.print("\n[yellow]These certificates end soon; `wonderland network renew`:[/yellow]")
        for one in soon:
            console.print(f"  {one.owner:<32} {one.expires}  ({one.days_left} days)", highlight=False)
    elif found.certificates:
        first = found.certificates[0]
        console.print(f"\ncertificates: the first to end is {first.owner}'s, {first.expires}", highlight=False)


def _follow(log: Path) -> None:
    with log.open("rb") as file:
        file.seek(0, os.SEEK_END)
        while True:
            data = file.read(1 << 16)
            if data:
                click.echo(data.decode(errors="replace"), nl=False)
            else:
                time.sleep(_FOLLOW_S)
