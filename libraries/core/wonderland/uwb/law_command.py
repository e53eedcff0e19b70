"""``wonderland uwb law``: what radio law says about UWB at a landing pad."""

from __future__ import annotations

import json

import click

from wonderland.uwb.regions import BY_CODE


@click.command()
@click.argument("code", metavar="REGION", type=click.Choice(tuple(BY_CODE), case_sensitive=False))
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def law(*, code: str, as_json: bool) -> None:
    """Say which channels a region has, and what forbids or licenses a pad's anchors and a drone's node there.

    A guide to what has to be looked up; no legal advice.
    """
    region = BY_CODE[code]
    if as_json:
        statements = [{"text": each.text, "source": each.source, "read": each.read} for each in region.statements]
        document = {"region": region.code, "channels": list(region.channels), "statements": statements}
        click.echo(json.dumps(document))
        return
    click.echo(f"{region.name}: channels {', '.join(map(str, region.channels))}")
    for each in region.statements:
        click.echo(f"- {each.text}")
        click.echo(f"  {each.source}{'' if each.read else ' (not read here: verify)'}")
    click.echo("No legal advice: your authority decides.")
