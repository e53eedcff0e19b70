"""``wonderland ros2 router``: what ROS 2's peers meet at, where no ROS is installed."""

from __future__ import annotations

import signal
from typing import Final

import click

from wonderland.service_manager import ServiceManager, held
from wonderland_rmw_zenoh.errors import Ros2Error
from wonderland_rmw_zenoh.session import ROUTER, Link, open_session

_TOLD: Final = {signal.SIGINT, signal.SIGTERM}


@click.command()
@click.option("--listen", default=ROUTER, show_default=True, metavar="tcp/127.0.0.1:PORT", help="Where; loopback only.")
def router(*, listen: str) -> None:
    """Bring peers of ROS 2 on this machine together, as rmw_zenohd does, until told to stop (Ctrl-C, SIGTERM)."""
    with held(_TOLD):  # before Zenoh's threads
        try:
            session = open_session(Link(connect=(), listen=(listen,), mode="router"))
        except Ros2Error as error:
            raise click.ClickException(f"{error} (is another router there already?)") from error
        click.echo(f"A router at {listen}, for this machine alone. Ctrl-C stops it.")
        manager = ServiceManager()
        manager.tell("READY=1")
        signal.sigwait(_TOLD)
        manager.tell("STOPPING=1")
        session.close()  # type: ignore[no-untyped-call]  # zenoh's stub says nothing of it
