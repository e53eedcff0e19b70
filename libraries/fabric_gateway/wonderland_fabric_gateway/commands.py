"""``wonderland ledger``: run the embedded ledger, look at it, and manage who may use it."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.administration import INVITATION_HOURS, DirectoryAdministration, Issued
from wonderland_fabric_gateway.embedded.contracts import load_contract
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.embedded.node import EmbeddedLedger, LedgerSettings
from wonderland_fabric_gateway.embedded.orderer import DEFAULT_BATCH_COUNT, DEFAULT_BATCH_MS, BatchLimits
from wonderland_fabric_gateway.errors import LedgerError

if TYPE_CHECKING:
    from collections.abc import Callable

_data = click.option(
    "--data",
    "directory",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="The ledger's directory.",
)
_json = click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document.")
_organisation = click.option(
    "--org",
    "msp_id",
    metavar="MSP_ID",
    help="The organisation; needed only where the name or the role does not tell.",
)


class _Group(click.Group):
    """Every error of the ledger's own ends as one line and exit code 1, never as a stack trace."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except LedgerError as error:
            raise click.ClickException(str(error)) from error


@click.group(cls=_Group)
def ledger() -> None:
    """Run a ledger on this machine, and manage who may use it.

    \b
    A first try:
      wonderland ledger start --data ./my-ledger --listen 127.0.0.1:7051
      wonderland ledger status --data ./my-ledger
      wonderland ledger ca enrol pad-7 --data ./my-ledger --role pad

    Everything that connects takes DIR/connection.json. This is a single-node ledger for trying, developing and single
    sites: one process holds the keys of all organisations, so it gives no multi-party trust.
    """  # noqa: D301 - \b is click's mark for "do not wrap"


@ledger.command()
@_data
@click.option("--listen", default="127.0.0.1:7051", show_default=True, metavar="HOST:PORT", help="0 takes a free port.")
@click.option("--advertise", default="", metavar="HOST", help="Name or address by which other machines reach it.")
@click.option("--channel", default=orgs.DEFAULT_CHANNEL, show_default=True, help="The channel's name (first start).")
@click.option(
    "--contract",
    default=orgs.DEFAULT_CHAINCODE,
    show_default=True,
    metavar="NAME",
    help="The installed contract to run, or CHAINCODE=NAME to run it under another chaincode name.",
)
@click.option(
    "--pad-operator",
    "pad_operators",
    multiple=True,
    metavar="MSP_ID",
    help="Another operator of pads besides PadMSP (first start; may be given several times).",
)
@click.option(
    "--batch-ms",
    default=DEFAULT_BATCH_MS,
    show_default=True,
    type=click.IntRange(0, 60_000),
    help="How long a transaction waits at most for others to share its block.",
)
@click.option(
    "--batch-count",
    default=DEFAULT_BATCH_COUNT,
    show_default=True,
    type=click.IntRange(1, 10_000),
    help="Transactions that fill a block.",
)
@_json
def start(
    *,
    directory: Path,
    listen: str,
    advertise: str,
    channel: str,
    contract: str,
    pad_operators: tuple[str, ...],
    batch_ms: int,
    batch_count: int,
    as_json: bool,
) -> None:
    """Run the ledger until it is stopped (Ctrl-C or SIGTERM).

    The first start makes a certificate authority for each organisation and one identity for each role. When the ledger
    serves, it writes DIR/connection.json; with --json it also says so by one line on standard output.
    """
    logging.basicConfig(stream=sys.stderr, format="%(asctime)s %(levelname)s %(name)s: %(message)s", level=logging.INFO)
    chaincode, _, name = contract.rpartition("=")
    chaincode = chaincode or name
    settings = LedgerSettings(
        listen=listen,
        channel=channel,
        chaincode=chaincode,
        advertise=advertise,
        pad_operators=pad_operators,
        limits=BatchLimits(batch_ms, batch_count),
    )
    node = EmbeddedLedger(directory, {chaincode: load_contract(name)}, settings)

    def ready() -> None:
        connection = node.connection
        if as_json:
            answer = {
                "ready": True,
                "address": connection.gateway.address,
                "connection": str(node.directory.connection_file.resolve()),
                "channel": connection.channel,
                "chaincode": connection.chaincode,
                "notice": NOTICE,
            }
            click.echo(json.dumps(answer))
            click.echo(NOTICE, err=True)
            return
        click.echo(f"ledger   {connection.gateway.address} (channel {connection.channel}, contract {chaincode})")
        click.echo(f"connect  {node.directory.connection_file.resolve()}")
        click.secho(f"\n{NOTICE}\n", fg="yellow")
        click.echo("Ctrl-C stops it.")

    asyncio.run(_serve(node, ready))


async def _serve(node: EmbeddedLedger, ready: Callable[[], None]) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    async with node:
        ready()
        await stop.wait()


@ledger.command()
@_data
@_json
def status(directory: Path, *, as_json: bool) -> None:
    """Say whether the ledger runs, how high its chain is, and what it does not promise."""
    answer = asyncio.run(DirectoryAdministration(LedgerDirectory(directory)).status())
    if as_json:
        click.echo(json.dumps(answer))
        return
    click.echo(f"ledger   {'runs, at ' + str(answer['address']) if answer['running'] else 'does not run'}")
    click.echo(f"channel  {answer['channel']}")
    click.echo(f"height   {answer['height']} blocks, tip {str(answer['tip_hash'])[:16]}…")
    if answer.get("trouble"):
        click.secho(f"trouble  {answer['trouble']}", fg="red")
    click.secho(f"\n{NOTICE}", fg="yellow")


@ledger.group()
def ca() -> None:
    """Certificates: enrol, renew, revoke, list. Works while the ledger runs; a revocation reaches it at once."""


@ca.command()
@click.argument("name")
@_data
@click.option("--role", required=True, type=click.Choice(tuple(orgs.ROLES)), help="What it may do (pol.role).")
@click.option("--id", "pol_id", default="", help="Registry id of the pad or drone (pol.id); the name unless given.")
@_organisation
@click.option("--days", default=365, show_default=True, type=click.IntRange(1, 5 * 365), help="Days it is valid.")
@_json
def enrol(*, name: str, directory: Path, role: str, pol_id: str, msp_id: str | None, days: int, as_json: bool) -> None:
    """Give NAME a key and a certificate, and add it to connection.json."""
    administration = DirectoryAdministration(LedgerDirectory(directory))
    issued = administration.enrol(name, role=role, pol_id=pol_id or name, msp_id=msp_id, days=days)
    _show(issued, as_json=as_json)


@ca.command()
@click.argument("name")
@_data
@click.option("--role", required=True, type=click.Choice(tuple(orgs.ROLES)), help="What it may do (pol.role).")
@click.option("--id", "pol_id", default="", help="Registry id of the pad or drone (pol.id); the name unless given.")
@_organisation
@click.option("--days", default=365, show_default=True, type=click.IntRange(1, 5 * 365), help="Days it is valid.")
@click.option(
    "--hours",
    default=INVITATION_HOURS,
    show_default=True,
    type=click.IntRange(1, 720),
    help="Hours in which the secret is good.",
)
@_json
def invite(
    *, name: str, directory: Path, role: str, pol_id: str, msp_id: str | None, days: int, hours: int, as_json: bool
) -> None:
    """Print a one-time secret with which NAME enrols itself, with a key that never leaves its place.

    People enter it in the console, under Registry, Signing key.
    """
    administration = DirectoryAdministration(LedgerDirectory(directory))
    invited = administration.invite(name, role=role, pol_id=pol_id or name, msp_id=msp_id, days=days, hours=hours)
    if as_json:
        click.echo(json.dumps({"name": name, "msp_id": invited.msp_id, "role": role, "secret": invited.secret}))
        return
    click.echo(f"{name} of {invited.msp_id}, role {role}; good once, within {hours} h:")
    click.echo(f"secret  {invited.secret}")


@ca.command()
@click.argument("name")
@_data
@_organisation
@click.option("--days", default=365, show_default=True, type=click.IntRange(1, 5 * 365), help="Days it is valid.")
@click.option("--revoke-old", is_flag=True, help="Revoke the former certificate now, instead of letting it expire.")
@_json
def renew(*, name: str, directory: Path, msp_id: str | None, days: int, revoke_old: bool, as_json: bool) -> None:
    """Give NAME a new key and certificate in place of the former one, with the same role and id."""
    administration = DirectoryAdministration(LedgerDirectory(directory))
    issued = asyncio.run(administration.renew(name, msp_id=msp_id, days=days, revoke_old=revoke_old))
    _show(issued, as_json=as_json)


@ca.command()
@click.argument("name", required=False)
@_data
@_organisation
@click.option("--serial", help="Revoke this one certificate (hexadecimal serial number) instead of all of a name.")
@click.option("--reason", default="unspecified", show_default=True, help="Reason code of RFC 5280, e.g. keyCompromise.")
@_json
def revoke(
    *, name: str | None, directory: Path, msp_id: str | None, serial: str | None, reason: str, as_json: bool
) -> None:
    """Revoke all certificates of NAME. A running ledger refuses them from the next block on."""
    administration = DirectoryAdministration(LedgerDirectory(directory))
    revoked, effect = asyncio.run(administration.revoke(name, serial=serial, msp_id=msp_id, reason=reason))
    if as_json:
        click.echo(json.dumps({"revoked": [each.serial for each in revoked], **effect}))
        return
    for each in revoked:
        click.echo(f"revoked  {each.name}, serial {each.serial}")
    if effect["running"]:
        since = "already" if effect["block"] is None else f"since block {effect['block']}"
        click.echo(f"The ledger refuses it {since}.")
    else:
        click.echo("The ledger does not run; it will refuse it when it starts.")


@ca.command("list")
@_data
@_organisation
@_json
def list_certificates(directory: Path, msp_id: str | None, *, as_json: bool) -> None:
    """List the certificates that were issued."""
    rows = DirectoryAdministration(LedgerDirectory(directory)).certificates(msp_id)
    if as_json:
        click.echo(json.dumps({"certificates": rows}))
        return
    for row in rows:
        click.echo(
            f"{row['msp_id']:<13} {row['name']:<18} {row['role'] or row['node_ou']:<15} {row['state']:<8} "
            f"until {row['valid_until']}  {row['serial']}"
        )


@ca.command()
@click.argument("name")
@_data
@click.option(
    "--to", "target", required=True, type=click.Path(file_okay=False, path_type=Path), help="A new or empty directory."
)
def export(name: str, directory: Path, target: Path) -> None:
    """Write what the machine of NAME needs to connect: its key, its certificate and a connection.json."""
    DirectoryAdministration(LedgerDirectory(directory)).export(name, target)
    click.echo(f"Copy {target} to that machine, over a safe way: it holds a private key.")


def _show(issued: Issued, *, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(issued.as_json()))
        return
    click.echo(f"{issued.name} of {issued.msp_id}, serial {issued.serial}, valid until {issued.valid_until}")
    click.echo(f"certificate  {issued.certificate}")
    click.echo(f"key          {issued.key}")
