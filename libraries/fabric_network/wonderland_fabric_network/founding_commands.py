"""``wonderland network card | meet``: members found a network together, each with its own machine and keys."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import click
from rich.table import Table

from wonderland.consoles import for_people
from wonderland.proofs.errors import RecordError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import binaries as servers
from wonderland_fabric_network import bringing_up, founding
from wonderland_fabric_network.cards import read_card, read_roster
from wonderland_fabric_network.console import dir_option, open_at, progress
from wonderland_fabric_network.description import KINDS, NetworkDescription, Organisation
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.membership import MemberCard, fingerprint, moment
from wonderland_fabric_network.network import Network


@click.command()
@click.argument("msp_ids", metavar="MSP…", nargs=-1, required=True)
@dir_option
@click.option(
    "--file",
    "file",
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    help="The description that all founders agreed on: the same network.yaml for everybody.",
)
@click.option(
    "--roster",
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    help="Of a network that was founded already, which you would join: a member's `network roster` wrote it.",
)
@click.option("--kind", type=click.Choice(KINDS), help="What you do, where you would join.")
@click.option(
    "--peers", type=click.IntRange(1, 20), default=1, show_default=True, help="How many, where you would join."
)
@click.option("--yes", is_flag=True, help="Do not ask whether the fingerprint was compared.")
@click.option("--host", help="This machine's address, by which the others reach its servers.")
@click.option("--first-port", type=click.IntRange(1, 60_000), help="Its ports are counted up from here.")
@click.option(
    "--to", "target", default=".", type=click.Path(file_okay=False, path_type=Path), help="Where the cards are written."
)
def card(
    *,
    msp_ids: tuple[str, ...],
    directory: Path,
    file: Path | None,
    roster: Path | None,
    kind: str | None,
    peers: int,
    yes: bool,
    host: str | None,
    first_port: int | None,
    target: Path,
) -> None:
    """Begin one member's part of a network: its CAs, keys and servers; and write its card for the others.

    \b
    Founders, each on its own machine, with its own organisations:
      wonderland network card PadMSP PadOrdererMSP --file network.yaml --host pads.example
    Nothing on a card is secret. Give it to the others, and take theirs:
      wonderland network meet AuthorityMSP.card FleetMSP.card …
    \b
    Who joins later begins with what a member gave it, and gives it the card:
      wonderland network card Pad2MSP --roster wonderland.roster --kind pads --host pads2.example
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    if (file is None) == (roster is None):
        raise click.UsageError("say one of --file (you found a network) and --roster (you join one)")
    if (roster is None) != (kind is None):
        raise click.UsageError("--roster and --kind belong together")
    servers.find_binaries()  # before anything is written
    told = None if roster is None else read_roster(roster)
    if told is None:
        assert file is not None
        description = NetworkDescription.load(file)
    else:
        (joining,) = msp_ids if len(msp_ids) == 1 else (None,)
        if joining is None:
            raise click.UsageError("one organisation joins at a time")
        try:
            organisation = Organisation.parse({"msp_id": joining, "kind": kind, "peers": peers})
        except RecordError as error:
            raise click.UsageError(str(error)) from error
        description = told.description.with_organisation(organisation)
        _show_members(told.cards, told.description, ())
        click.echo(f"first block  {fingerprint(told.block)}")
        if not yes:
            click.confirm("Does a member that you trust read the same (`wonderland network roster`)?", abort=True)
    description = replace(description, host=host or description.host, first_port=first_port or description.first_port)
    places = NetworkDirectory(directory)
    places.prepare()
    with places.lock(), progress() as report:
        made = founding.new_part(places, description, msp_ids, told)

        async def run() -> list[MemberCard]:
            return await founding.make_cards(made, await servers.check_binaries(), report, newcomer=told is not None)

        cards = asyncio.run(run())
    target.mkdir(parents=True, exist_ok=True)
    for each in cards:
        path = target / f"{each.msp_id}.card"
        write_atomic(path, each.to_bytes() + b"\n", PUBLIC)
        click.echo(f"card     {path}  {each.fingerprint}")
    click.echo(
        "Give it to the other members, and `wonderland network meet` theirs. Nothing on it is secret."
        if told is None
        else "Give it to a member, who proposes it to the others; read them its fingerprint. Then `wonderland network "
        "up`, which waits until they have admitted you."
    )


@click.command()
@click.argument("cards", nargs=-1, required=True, type=click.Path(dir_okay=False, exists=True, path_type=Path))
@dir_option
@click.option("--yes", is_flag=True, help="Do not ask whether the fingerprint was compared.")
def meet(*, cards: tuple[Path, ...], directory: Path, yes: bool) -> None:
    """Take the other members' CARDS, and found the network with them, or go on founding it.

    Everybody makes the channel's first block by himself. Its fingerprint is over all cards and the description: read it
    to each other by telephone. Who reads another one was given another card.
    """
    made = open_at(directory)
    with made.directory.lock(), progress() as report:
        made = founding.meet(made, [read_card(path) for path in cards])
        assert made.membership is not None
        missing = made.membership.missing(made.description)
        if missing:
            click.echo(f"kept; the cards of {', '.join(missing)} are missing yet")
            return
        block = bringing_up.channel_block(made)
    _show(made)
    click.echo(f"first block  {fingerprint(block)}")
    if not yes:
        click.confirm("Do all members read the same?", abort=True)
    with made.directory.lock(), progress() as report:

        async def run() -> None:
            await bringing_up.bring_up(made, await servers.check_binaries(), report)

        asyncio.run(run())
    click.echo(f"Channel {made.channel} is founded; {', '.join(made.msp_ids)} take part in it.")


def _show(network: Network) -> None:
    membership, description = network.membership, network.description
    assert membership is not None
    _show_members(membership.cards.values(), description, membership.mine)
    policy, ordering = description.contract.endorsement, description.ordering
    contract = next(iter(membership.cards.values())).contract
    click.echo(f"contract  {contract.version}, source {contract.sha256[:16]}; signed by {policy}")
    click.echo(f"ordering  {ordering.consensus}, {ordering.count} orderers")


def _show_members(cards: Iterable[MemberCard], description: NetworkDescription, mine: Collection[str]) -> None:
    kinds = {each.msp_id: each.kind for each in description.organisations}
    table = Table(box=None, pad_edge=False)
    for heading in ("member", "does", "at", "peers", "orderers", "card of"):
        table.add_column(heading)
    for each in cards:
        own = " (this one)" if each.msp_id in mine else ""
        table.add_row(
            f"{each.msp_id}{own}",
            kinds.get(each.msp_id, "orders blocks"),
            each.host,
            str(len(each.peers)),
            str(len(each.orderers)),
            moment(each),
        )
    for_people().print(table)


COMMANDS: Final = (card, meet)
