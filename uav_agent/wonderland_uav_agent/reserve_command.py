"""``wonderland uav reserve``: have a pad kept for this drone's landing, see for whom it is kept, give it up."""

from __future__ import annotations

import asyncio
import datetime as dt
from pathlib import Path

import click

from wonderland.clock import SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.reservations import Reservations
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_uav_agent.drone_options import from_config

_MINUTE_MS = 60_000


@click.command()
@from_config
@click.option("--connection", required=True, type=click.Path(path_type=Path), help="connection.json of the ledger.")
@click.option("--identity", default="uav", show_default=True, help="A name in connection.json.")
@click.option("--pad", "pad_id", required=True, help="The landing pad.")
@click.option("--in", "in_min", type=click.IntRange(0, 10_080), help="Minutes until it begins.")
@click.option("--minutes", type=click.IntRange(1, 60), default=15, show_default=True, help="For how long.")
@click.option("--give-up", is_flag=True, help="Cancel what this drone has reserved there.")
def reserve(*, connection: Path, identity: str, pad_id: str, in_min: int | None, minutes: int, give_up: bool) -> None:
    """Have a pad kept for this drone, where the pad's policy allows it; without --in, say for whom it is kept.

    Others wait from shortly before, but for emergencies and whoever the pad's operator puts first.
    """
    if give_up and in_min is not None:
        raise click.UsageError("--give-up and --in: one or the other")
    try:
        kept = asyncio.run(_reserve(connection, identity, pad_id, in_min, minutes, give_up=give_up))
    except LedgerError as error:
        raise click.ClickException(str(error)) from error
    now_ms = SteadyClock()()
    to_come = [each for each in kept.reservations if now_ms < each.until_ms]
    for each in to_come:
        click.echo(f"{_local(each.from_ms)} to {_local(each.until_ms)}  {each.uav_id}  (by {each.reserved_by})")
    if not to_come:
        click.echo(f"{pad_id} is kept for nobody")


async def _reserve(
    connection: Path, identity: str, pad_id: str, in_min: int | None, minutes: int, *, give_up: bool
) -> Reservations:
    where = Connection.load(connection)
    who = where.identity(identity)
    async with where.open_channel() as channel:
        ledger = ProofContract(Gateway(channel, who, where.signer(identity)).network(where.channel), where.chaincode)
        if in_min is not None:
            from_ms = SteadyClock()() + in_min * _MINUTE_MS
            wanted = tx.ReservePad(
                pad_id=pad_id, uav_id=who.pol_id, from_ms=from_ms, until_ms=from_ms + minutes * _MINUTE_MS
            )
            return (await ledger.reserve(wanted))[0]
        kept = await ledger.read_reservations(pad_id)
        for each in kept.reservations if give_up else ():
            if each.uav_id == who.pol_id:
                its = tx.CancelReservation(pad_id=pad_id, reservation_id=each.reservation_id)
                kept, _ = await ledger.cancel_reservation(its)
        return kept


def _local(t_ms: int) -> str:
    return f"{dt.datetime.fromtimestamp(t_ms / 1_000).astimezone():%Y-%m-%d %H:%M}"
