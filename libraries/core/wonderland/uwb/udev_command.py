"""``wonderland uwb udev``: a stable name for a board, whichever USB port and order it comes in."""

from __future__ import annotations

import re

import click
from serial.tools import list_ports

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")


@click.command()
@click.option("--port", required=True, help="Where the board hangs now, for example /dev/ttyACM0.")
@click.option("--name", required=True, help="What it shall be called: /dev/wonderland/NAME.")
def udev(*, port: str, name: str) -> None:
    """Print the udev rule that gives the board on a port a name of its own; append it to a file of rules.

    \b
      wonderland uwb udev --port /dev/ttyACM0 --name A1 | sudo tee -a /etc/udev/rules.d/60-wonderland.rules
      sudo udevadm control --reload && sudo udevadm trigger
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    if not _NAME.fullmatch(name):
        raise click.BadParameter(f"{name!r}: letters, digits, - and _, 32 at most", param_hint="--name")
    found = {each.device: each for each in list_ports.comports(include_links=True)}
    board = found.get(port)
    if board is None:
        there = ", ".join(sorted(found)) or "none"
        raise click.ClickException(f"{port}: no serial port; there are: {there}")
    if board.vid is None or board.pid is None:
        raise click.ClickException(f"{port}: hangs on no USB port; its name does not change")
    same = [
        each.device
        for each in list_ports.comports()
        if (each.vid, each.pid, each.serial_number) == (board.vid, board.pid, board.serial_number)
        and each.location != board.location
    ]
    if board.serial_number and not same:
        told = f'ATTRS{{serial}}=="{board.serial_number}"'
    elif board.location:
        # Boards of one kind without serial numbers of their own are told by the hub's port they hang on.
        told = f'KERNELS=="{board.location.partition(":")[0]}"'
    else:
        raise click.ClickException(f"{port}: neither a serial number nor a place on the bus is known")
    usb = f'ATTRS{{idVendor}}=="{board.vid:04x}", ATTRS{{idProduct}}=="{board.pid:04x}"'
    if told.startswith("KERNELS"):
        usb = f'ENV{{ID_VENDOR_ID}}=="{board.vid:04x}", ENV{{ID_MODEL_ID}}=="{board.pid:04x}"'
    click.echo(f'SUBSYSTEM=="tty", {usb}, {told}, SYMLINK+="wonderland/{name}", GROUP="dialout", MODE="0660"')
