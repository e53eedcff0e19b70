"""``wonderland network card | meet``: members found a network together, each with its own machine and keys."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Final

import click
from rich.table import Table

from wonderland.consoles import for_people
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_network import binaries as servers
from wonderland_fabric_network import bringing_up, founding
from wonderland_fabric_network.cards import read_card
from wonderland_fabric_network.console import dir_option, open_at, progress
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.layout import NetworkDirectory
from wonderland_fabric_network.membership import MemberCard, fingerprint, moment
from wonderland_fabric_network.network import Network


@click.command()
@click.argument("msp_ids", metavar="MSP…", nargs=-1, required=True)
@dir_option
@click.option(
    "--file",
    "file",
    required=True,
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    help="The description that all members agreed on: the same network.yaml for everybody.",
)
@click.option("--host", help="This machine's address, by which the others reach its servers.")
@click.option("--first-port", type=click.IntRange(1, 60_000), help="Its ports are counted up from here.")
@click.option(
    "--to", "target", default=".", type=click.Path(file_okay=False, path_type=Path), help="Where the cards are written."
)
def card(
    *, msp_ids: tuple[str, ...], directory: Path, file: Path, host: str | None, first_port: int | None, target: Path
) -> None:
    """Begin one member's part of a network: its CAs, keys and servers; and write its card for the others.

    \b
    Each member, on its own machine, with its own organisations:
      wonderland network card PadMSP PadOrdererMSP --file network.yaml --host pads.example
    Nothing on a card is secret. Give it to the others, and take theirs:
      wonderland network meet AuthorityMSP.card FleetMSP.card …
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    description = NetworkDescription.load(file)
    description = replace(description, host=host or description.host, first_port=first_port or description.first_port)
    servers.find_binaries()  # before anything is written
    places = NetworkDirectory(directory)
    places.prepare()
    with places.lock(), progress() as report:
        made = founding.new_part(places, description, msp_ids)

        async def run() -> list[MemberCard]:
            return await founding.make_cards(made, await servers.check_binaries(), report)

        cards = asyncio.run(run())
    target.mkdir(parents=True, exist_ok=True)
    for each in cards:
        path = target / f"{each.msp_id}.card"
        write_atomic(path, each.to_bytes() + b"\n", PUBLIC)
        click.echo(f"card     {path}")
    click.echo("Give it to the other members, and `wonderland network meet` theirs. Nothing on it is secret.")


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
    kinds = {each.msp_id: each.kind for each in description.organisations}
    table = Table(box=None, pad_edge=False)
    for heading in ("member", "does", "at", "peers", "orderers", "card of"):
        table.add_column(heading)
    for msp_id, each in membership.cards.items():
        own = " (this one)" if msp_id in membership.mine else ""
        table.add_row(
            f"{msp_id}{own}",
            kinds.get(msp_id, "orders blocks"),
            each.host,
            str(len(each.peers)),
            str(len(each.orderers)),
            moment(each),
        )
    console = for_people()
    console.print(table)
    policy, ordering = description.contract.endorsement, description.ordering
    contract = next(iter(membership.cards.values())).contract
    console.print(f"contract  {contract.version}, source {contract.sha256[:16]}; signed by {policy}", highlight=False)
    console.print(f"ordering  {ordering.consensus}, {ordering.count} orderers", highlight=False)


COMMANDS: Final = (card, meet)
