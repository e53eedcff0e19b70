"""``wonderland ros1 status`` (and ``ros2``) and ``rejected``: what waits for the ledger, and what it refused."""

from __future__ import annotations

import json
from pathlib import Path

import click

from wonderland.toml_settings import SettingsError
from wonderland_ros_bridge.config_option import config
from wonderland_ros_bridge.either import Settings, load
from wonderland_ros_bridge.errors import BridgeError
from wonderland_ros_bridge.ledger.outbox import Outbox
from wonderland_ros_bridge.ledger.outbox_view import OutboxView


def _settings(path: Path) -> Settings:
    try:
        return load(path)
    except SettingsError as error:
        raise click.ClickException(str(error)) from error


@click.command()
@config
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def status(*, path: Path, as_json: bool) -> None:
    """Say what waits for the ledger, by topic, and what was refused. The bridge may run meanwhile."""
    settings = _settings(path)
    try:
        with OutboxView(settings.spool) as view:
            found = view.summary()
    except BridgeError as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps(found))
        return
    click.echo(f"Bridge {settings.bridge}: {found['waiting']} messages wait for the ledger.")
    for each in found["topics"]:
        click.echo(f"  {each['topic']}: {each['received']} received, {each['waiting']} wait")
    if found["rejected"]:
        click.echo(f"{found['rejected']} batches were refused: {settings.command} rejected --config {path}")


@click.command()
@config
@click.option("--json", "as_json", is_flag=True, help="One JSON line each, with what was refused.")
@click.option("--again", is_flag=True, help="Put them back, to be sent again (the bridge must not run).")
@click.option("--forget", type=int, metavar="ID", help="Remove one for good (the bridge must not run).")
def rejected(*, path: Path, as_json: bool, again: bool, forget: int | None) -> None:
    """Show what the ledger refused for good, each with its reason. Nothing of it is lost until it is forgotten."""
    settings = _settings(path)
    try:
        if again or forget is not None:
            outbox = Outbox(settings.spool, bridge=settings.bridge)
            try:
                count = outbox.send_again() if again else outbox.forget(forget or 0)
            finally:
                outbox.close()
            click.echo(f"{count} messages wait again." if again else f"{count} removed.")
            return
        with OutboxView(settings.spool) as view:
            found = view.rejected()
    except BridgeError as error:
        raise click.ClickException(str(error)) from error
    for each in found:
        if as_json:
            click.echo(json.dumps(each))
        else:
            click.echo(f"{each['id']}  {each['topic']}  {each['code']}: {each['reason']}")
    if not found and not as_json:
        click.echo("Nothing was refused.")
