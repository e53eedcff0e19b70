"""``wonderland network roster | propose | sign | submit | upgrade | add-org``: what a running channel is to be."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Final

import click

from wonderland.proofs.errors import RecordError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import binaries as servers
from wonderland_fabric_network import expansion, upgrading
from wonderland_fabric_network.cards import read_card, read_change
from wonderland_fabric_network.changes import Batching, ChannelChange, Count
from wonderland_fabric_network.changing import Changing
from wonderland_fabric_network.console import dir_option, json_option, open_at, progress
from wonderland_fabric_network.description import Organisation
from wonderland_fabric_network.membership import fingerprint, moment
from wonderland_fabric_network.network import Network

_FILE: Final = click.Path(dir_okay=False, exists=True, path_type=Path)
_UNSIGNED: Final = "0" * 64


@click.command()
@dir_option
@click.option(
    "--to",
    "target",
    default="wonderland.roster",
    show_default=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="Where it is written.",
)
def roster(*, directory: Path, target: Path) -> None:
    """Write what an organisation that would join needs to know of this network. Nothing in it is secret.

    It begins with `wonderland network card Pad2MSP --kind pads --roster FILE`, and compares the fingerprint with you.
    """
    made = open_at(directory)

    async def run() -> None:
        async with Changing(made) as member:
            told = member.roster()
        write_atomic(target, told.encode() + b"\n", PUBLIC)
        click.echo(f"roster       {target}")
        click.echo(f"first block  {fingerprint(told.block)}")

    asyncio.run(run())


@click.command()
@dir_option
@click.option("--admit", "card", type=_FILE, help="Have the organisation of this card join.")
@click.option("--remove", "msp_id", help="Have an organisation leave.")
@click.option(
    "--batch",
    nargs=2,
    type=(click.IntRange(1, 60_000), click.IntRange(1, 10_000)),
    metavar="MS COUNT",
    help="A block is made after so many milliseconds, or of so many transactions.",
)
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--to", "target", type=click.Path(dir_okay=False, path_type=Path), help="Where the change is written.")
def propose(
    *,
    directory: Path,
    card: Path | None,
    msp_id: str | None,
    batch: tuple[int, int] | None,
    yes: bool,
    target: Path | None,
) -> None:
    """Propose a change of the channel, and sign it as this member: a file for the others.

    \b
      wonderland network propose --admit Pad2MSP.card
      wonderland network sign admit-Pad2MSP.change      # each of the others, until a majority has
      wonderland network submit admit-Pad2MSP.change    # then each of them, the first has it made
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    if sum(each is not None for each in (card, msp_id, batch)) != 1:
        raise click.UsageError("say one of --admit CARD, --remove MSP, --batch MS COUNT")
    made = open_at(directory)
    change = ChannelChange(
        channel=made.channel,
        update_sha256=_UNSIGNED,
        admit=None if card is None else read_card(card),
        remove=msp_id,
        batching=None if batch is None else Batching(timeout_ms=batch[0], count=batch[1]),
    )
    name = f"admit-{change.admit.msp_id}" if change.admit else f"remove-{msp_id}" if msp_id else "batching"
    file = target or Path(f"{name}.change")

    async def run() -> None:
        async with Changing(made) as member:
            proposed = await member.propose(change)
            _show(made, proposed)
            _confirm(yes=yes)
            await _sign(member, proposed, file)

    asyncio.run(run())


@click.command()
@click.argument("file", type=_FILE)
@dir_option
@click.option("--yes", is_flag=True, help="Do not ask.")
def sign(*, file: Path, directory: Path, yes: bool) -> None:
    """Show what a change would do, and sign it as this member. The signature is added to FILE.

    What is signed is computed here, from what the change says and from the channel as this member's own peer has it.
    """
    made = open_at(directory)
    change = read_change(file)

    async def run() -> None:
        async with Changing(made) as member:
            counted = await member.count(change)
            _show(made, change)
            if counted is None:
                click.echo("The channel is so already; `wonderland network submit` takes note of it.")
                return
            click.echo(f"signed by    {', '.join(counted.signed) or 'nobody yet'}")
            _confirm(yes=yes)
            await _sign(member, change, file)

    asyncio.run(run())


@click.command()
@click.argument("files", nargs=-1, required=True, type=_FILE)
@dir_option
def submit(*, files: tuple[Path, ...], directory: Path) -> None:
    """Have a change made that a majority signed; or, where it is made already, take note of it here.

    Members may sign copies of one file at the same time: give all of them.
    """
    made = open_at(directory)
    change = read_change(files[0])
    for each in files[1:]:
        change = change.merged(read_change(each))

    async def run() -> int | None:
        async with Changing(made) as member:
            return (await member.submit(change))[1]

    with made.directory.lock():
        block = asyncio.run(run())
    click.echo("The channel was so already; noted here." if block is None else f"made in block {block}")
    if change.admit is not None:
        click.echo(
            f"Give the file to the other members, who `submit` it to take note. {change.admit.msp_id} goes on with "
            "`wonderland network up`."
        )
        if change.admit.kind == "pads":
            click.echo(
                "What belongs to its pads needs its signature: all agree on that by `wonderland network upgrade`."
            )


@click.command()
@dir_option
@click.option("--endorsement", metavar="POLICY", help="Agree on this policy, too: AND('AuthorityMSP.peer', …).")
@click.option("--without", multiple=True, metavar="MSP", help="Do not wait for this member; a majority is needed.")
@json_option
def upgrade(*, directory: Path, endorsement: str | None, without: tuple[str, ...], as_json: bool) -> None:
    """Have every organisation agree on the contract that is installed now, while the former one runs on.

    Where each member has its own part, each runs this, with the same --endorsement if any; it waits for the others.
    """
    made = open_at(directory)
    with made.directory.lock(), progress(quiet=as_json) as report:
        _, done = asyncio.run(upgrading.upgrade(made, report, endorsement=endorsement, without=without))
    if as_json:
        click.echo(json.dumps(done.as_json()))
        return
    what = f"version {done.agreement.version}, sequence {done.agreement.sequence}, endorsement {done.endorsement}"
    click.echo(f"agreed   {what}" if done.changed else f"nothing to agree on: {what} holds already")


@click.command("add-org")
@click.argument("msp_id")
@dir_option
@click.option("--kind", required=True, type=click.Choice(["pads", "fleet"]), help="What it does.")
@click.option("--peers", default=1, show_default=True, type=click.IntRange(1, 20), help="How many peers it runs.")
@click.option("--endorsement", metavar="POLICY", help="Agree on this policy, too; it names the organisation.")
@json_option
def add_org(*, msp_id: str, directory: Path, kind: str, peers: int, endorsement: str | None, as_json: bool) -> None:
    """Have another organisation join the running channel, with its own CA and peers.

    \b
    A second operator of pads:
      wonderland network add-org Pad2MSP --kind pads
    Its own pads' records then need its signature, and a transaction about nobody's pad its signature or the first
    operator's. A policy of your own is changed by hand, for example to
      --endorsement "AND('AuthorityMSP.peer', OR('PadMSP.peer', 'Pad2MSP.peer'))"
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    made = open_at(directory)
    try:
        organisation = Organisation.parse({"msp_id": msp_id, "kind": kind, "peers": peers})
    except RecordError as error:
        raise click.ClickException(str(error)) from error
    with made.directory.lock(), progress(quiet=as_json) as report:

        async def run() -> expansion.Joined:
            return await expansion.add_organisation(
                made, await servers.check_binaries(), organisation, report, endorsement=endorsement
            )

        joined = asyncio.run(run())
    connection = made.directory.organisation(msp_id).connection_file
    if as_json:
        agreed = None if joined.upgrade is None else joined.upgrade.as_json()
        click.echo(
            json.dumps({"msp_id": msp_id, "block": joined.block, "connection": str(connection), "agreement": agreed})
        )
        return
    click.echo(f"{msp_id} takes part{'' if joined.block is None else f' since block {joined.block}'}")
    click.echo(f"connect  {connection}")


async def _sign(member: Changing, change: ChannelChange, file: Path) -> None:
    signed, counted = await member.sign(change)
    write_atomic(file, signed.to_bytes(), PUBLIC)
    click.echo(f"change       {file}")
    click.echo(f"signed by    {', '.join(counted.signed)}")
    click.echo(_next(counted, file))


def _next(counted: Count, file: Path) -> str:
    if counted.enough:
        return f"That is enough: any member may `wonderland network submit {file}`."
    return f"Not enough yet: give it to {', '.join(counted.missing)}, who `wonderland network sign` it."


def _confirm(*, yes: bool) -> None:
    if not yes:
        click.confirm("Sign it?", abort=True)


def _show(network: Network, change: ChannelChange) -> None:
    """What would be different, in words."""
    before, after = network.description, change.applied(network.description)
    if change.admit is not None:
        card = change.admit
        click.echo(f"joins        {card.msp_id}: {_DOES[card.kind or '']}, {len(card.peers)} peers at {card.host}")
        click.echo(f"its card     {card.fingerprint}, of {moment(card)}. It reads you the same by telephone.")
    elif change.remove is not None:
        click.echo(
            f"leaves       {change.remove}, at once: the channel refuses all its people, pads, drones and servers"
        )
    elif change.batching is not None:
        old, new = before.ordering, change.batching
        click.echo(f"blocks       after {old.batch_timeout_ms} ms → {new.timeout_ms} ms")
        click.echo(f"             of {old.batch_count} → {new.count} transactions")
    if len(before.organisations) != len(after.organisations):
        click.echo(
            f"a majority   is {_majority(len(after.organisations))} (was {_majority(len(before.organisations))})"
        )


def _majority(members: int) -> str:
    return f"{members // 2 + 1} of {members}"


_DOES: Final = {"authority": "an authority", "pads": "operates pads", "fleet": "operates drones"}
COMMANDS: Final = (roster, propose, sign, submit, upgrade, add_org)
