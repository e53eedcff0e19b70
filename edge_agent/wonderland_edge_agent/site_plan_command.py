"""``wonderland pad site-plan``: check a plan before it goes to the backend."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

import click

from wonderland.site_plans import MAX_BYTES, SitePlanError, parse


@click.command("site-plan")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def site_plan(*, file: Path, as_json: bool) -> None:
    """Check a plan of the pad's site (GeoJSON, metres) as the backend will; exit code 1 where something is wrong.

    The console takes the file on the pad's page in the registry, shows it, and has its hash signed.
    """
    with file.open("rb") as opened:
        body = opened.read(MAX_BYTES + 1)
    try:
        plan = parse(body)
    except SitePlanError as error:
        if as_json:
            click.echo(json.dumps({"problems": [{"where": each.where, "what": each.what} for each in error.problems]}))
        for each in () if as_json else error.problems:
            click.echo(f"{file}: {each}", err=True)
        sys.exit(1)
    sha256 = hashlib.sha256(body).hexdigest()
    if as_json:
        click.echo(json.dumps({"sha256": sha256, "features": len(plan.features), "image": plan.image is not None}))
        return
    click.echo(f"{len(plan.features)} features{', an image' if plan.image else ''}: a site plan. SHA-256 {sha256}")
