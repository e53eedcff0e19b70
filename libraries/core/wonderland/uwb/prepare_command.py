"""``wonderland uwb prepare``: a DWM1001 with its factory firmware gets its role by its shell."""

from __future__ import annotations

import asyncio
import json
from typing import Final

import click

from wonderland.uwb.commands import sixteen_bits
from wonderland.uwb.port_options import PORT
from wonderland.uwb.port_options import baud_rate as with_baud_rate
from wonderland.uwb.port_options import rtscts as with_rtscts
from wonderland_fira_uci.dwm1001.roles import TENTHS, Role
from wonderland_fira_uci.dwm1001.roles import prepare as put_into_role
from wonderland_fira_uci.errors import UwbError
from wonderland_fira_uci.serial_port import serial_opener

ROLES: Final = {"pad": Role.TAG, "drone": Role.INITIATOR}


def _network(_: click.Context, __: click.Parameter, text: str) -> int:
    number = sixteen_bits(text, "network")
    if not 0 < number < 0xFFFF:
        raise click.BadParameter("0000 and ffff are no networks")
    return number


def _tenths(_: click.Context, __: click.Parameter, every_ms: int) -> int:
    """The firmware's unit; what does not fit is refused, not rounded."""
    if every_ms % (1000 // TENTHS):
        raise click.BadParameter(f"{every_ms} ms: the firmware counts in steps of 100 ms")
    return every_ms // (1000 // TENTHS)


@click.command()
@click.option(
    "--port",
    required=True,
    type=PORT,
    help="Port of the board: a device, socket://HOST:PORT or rfc2217://HOST:PORT.",
)
@with_baud_rate
@with_rtscts
@click.option(
    "--role",
    required=True,
    type=click.Choice(tuple(ROLES)),
    help="pad: a tag, which measures its own range; drone: the initiating anchor.",
)
@click.option(
    "--network", required=True, callback=_network, metavar="HEX", help="The network of this pad and its drones."
)
@click.option(
    "--every-ms",
    "tenths",
    callback=_tenths,
    type=click.IntRange(100, 60_000),
    default=100,
    show_default=True,
    help="pad: between two rounds, in steps of 100 ms.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def prepare(*, port: str, baud_rate: int, rtscts: bool, role: str, network: int, tenths: int, as_json: bool) -> None:
    """Put a DWM1001 with its factory firmware (PANS) into its role, and check that it took it.

    \b
    The network stands the other way round than for indoor positioning: each board of the *pad* is a tag on a serial
    port of its own, the board of the *drone* is the anchor. Such ranges can be recorded, and proofs with them have
    assurance 0, since nothing on the air binds them to a session.
      wonderland uwb prepare --port /dev/ttyACM0 --role pad --network 3caf     (each of the pad's)
      wonderland uwb prepare --port /dev/ttyACM0 --role drone --network 3caf   (says its address)

    What is so already is left alone. Exit code 1 when the board does not answer or did not take its role.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    try:
        opener = serial_opener(port, baud_rate, rtscts=rtscts)
        info = asyncio.run(put_into_role(opener, ROLES[role], network, name=port, tenths=tenths))
    except UwbError as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        told = {"address": f"{info.address:04x}", "network": f"{info.network:04x}", "mode": info.mode}
        click.echo(json.dumps({**told, "firmware": info.firmware, "encrypted": info.encrypted}))
        return
    what = "a tag of the pad" if role == "pad" else "the anchor of the drone"
    click.echo(f"Board {info.address:04x} is {what} in network {info.network:04x} (firmware {info.firmware}).")
    if role == "drone":
        click.echo(f"Tags in its network range it. The drone's agent: --node dwm1001-anchor --board {info.address:04x}")
