"""``wonderland pad``: run a pad's agent, and see how it is."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import signal
import sys
import time
from pathlib import Path
from typing import Any

import click

from wonderland.site_plans import MAX_BYTES, SitePlanError, parse
from wonderland_edge_agent.commissioning.commands import commission
from wonderland_edge_agent.settings import SettingsError, load

_config = click.option(
    "--config",
    "path",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="The pad's settings (TOML).",
)
STALE_S = 30
CANNOT_PROVE = 3
"""Exit code of ``pad status``; 2 is click's, for wrong options."""
LEVEL_ALONE = 3
"""Highest assurance that a pad reaches by itself."""


@click.group()
def pad() -> None:
    """Calibrate a landing pad, and run its agent.

    \b
    A pad is known to the ledger (RegisterPad), surveyed (CommissionPad) and has an identity with the role "pad".
      wonderland pad commission --recording ranges.csv --anchors anchors.csv --out commissioning.json
      wonderland pad site-plan plan.geojson
      wonderland pad run --config pad.toml
      wonderland pad status --config pad.toml

    pad.toml names the pad, connection.json with the identity, a directory for the spool, one serial port for each
    anchor, where Remote ID is heard, and the backend. A mistake in it is reported with the field's name.
    """  # noqa: D301 - \b is click's mark for "do not wrap"


pad.add_command(commission)


@pad.command()
@_config
@click.option("--json", "as_json", is_flag=True, help="One JSON line when the pad is ready, instead of text.")
@click.option("--check", is_flag=True, help="Read the settings, say which Remote ID sources can be trusted, and end.")
@click.option("-v", "--verbose", is_flag=True, help="Say more in the log.")
def run(*, path: Path, as_json: bool, check: bool, verbose: bool) -> None:
    """Work until told to stop (Ctrl-C or SIGTERM); what is under way then ends in a recorded state."""
    from wonderland_edge_agent.ports import AgentError  # noqa: PLC0415 - `pad status` needs none of it

    if check:
        _check(path)
        return
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.INFO,
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    logging.getLogger("websockets").setLevel(logging.WARNING)
    try:
        asyncio.run(_run(path, as_json=as_json))
    except (SettingsError, AgentError) as error:
        raise click.ClickException(str(error)) from error


def _check(path: Path) -> None:
    """What the settings say, without opening anything."""
    from wonderland_edge_agent.receiver.settings import trust  # noqa: PLC0415 - `pad status` needs none of it

    try:
        settings = load(path)
    except SettingsError as error:
        raise click.ClickException(str(error)) from error
    sources = trust(settings.remote_id_listen, settings.remote_id_serial, settings.receivers)
    click.echo(f"Pad {settings.pad_id}: the settings can be read.")
    click.echo("Remote ID is heard from:" if sources else "No Remote ID is heard: no receiver is set.")
    for source in sources:
        click.echo(f"  {source}")


async def _run(path: Path, *, as_json: bool) -> None:
    from wonderland_edge_agent.assembly import open_pad  # noqa: PLC0415 - `pad status` needs none of it

    settings = load(path)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    async with open_pad(settings) as agent:
        working = asyncio.create_task(agent.run())
        ready = asyncio.create_task(agent.wait_ready())
        stopping = asyncio.create_task(stop.wait())
        try:
            await asyncio.wait({working, ready, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if ready.done():
                click.echo(
                    json.dumps({"ready": True, "pad_id": settings.pad_id})
                    if as_json
                    else f"Pad {settings.pad_id} is ready. Ctrl-C stops it."
                )
            await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (ready, stopping, working):
                task.cancel()
            outcome = (await asyncio.gather(working, ready, stopping, return_exceptions=True))[0]
    if isinstance(outcome, Exception):
        raise outcome


@pad.command("site-plan")
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


@pad.command()
@_config
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def status(*, path: Path, as_json: bool) -> None:
    """Say how the pad is. Exit code 0: it can prove; 1: its agent does not run; 3: it runs and cannot prove.

    An agent that has said nothing for half a minute does not run, or hangs.
    """
    from wonderland_edge_agent.health import read_status  # noqa: PLC0415 - the others need none of it
    from wonderland_fabric_gateway.errors import LedgerError  # noqa: PLC0415

    try:
        settings = load(path)
        said = read_status(settings.status_file)
    except (SettingsError, LedgerError) as error:
        raise click.ClickException(str(error)) from error
    age_s = _age_s(said)
    alive = age_s <= STALE_S
    if as_json:
        click.echo(json.dumps({**said, "alive": alive, "age_s": round(min(age_s, 1e9), 1)}))
    else:
        _show(said, alive=alive, age_s=age_s)
    sys.exit((0 if said.get("accepts_sessions") is True else CANNOT_PROVE) if alive else 1)


def is_alive(status_file: Path) -> bool:
    """Whether the agent that writes this status file has done so lately."""
    from wonderland_edge_agent.health import read_status  # noqa: PLC0415
    from wonderland_fabric_gateway.errors import LedgerError  # noqa: PLC0415

    try:
        return _age_s(read_status(status_file)) <= STALE_S
    except LedgerError:
        return False


def _age_s(said: dict[str, Any]) -> float:
    t_ms = said.get("t_ms")
    return time.time() - t_ms / 1000 if isinstance(t_ms, int) else float("inf")


def _show(said: dict[str, Any], *, alive: bool, age_s: float) -> None:
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    console = Console()
    state = "can prove" if said.get("accepts_sessions") is True else "cannot prove"
    state = state if alive else f"silent for {age_s:.0f} s: it is not running, or hangs"
    console.print(f"Pad {said.get('pad_id', '?')}: {state}", soft_wrap=True)
    reasons = said.get("cannot_prove")
    for reason in reasons if isinstance(reasons, list) else ():
        console.print(f"  {reason}", soft_wrap=True, markup=False, highlight=False)
    table = Table(box=None, show_header=False)
    with contextlib.suppress(KeyError, TypeError):
        table.add_row("session", said["session"] or "none under way")
        table.add_row("run since start", str(said["sessions_run"]))
        table.add_row("waiting, to be ended", f"{said['requests_waiting']}, {said['sessions_to_end']}")
        table.add_row("prekeys offered", str(said.get("prekeys", "not known yet: the ledger has not said it")))
        spool = said["spool"]
        table.add_row("spool", f"{spool['records']} records, {spool['bytes']} bytes, {spool['dropped']} dropped")
        table.add_row("Remote ID", f"{said['receiver']['frames']} frames, {said['receiver']['bad']} bad")
        if "drift" in said:
            table.add_row("as commissioned", _drift(said["drift"]))
        for label, text in _reach(said.get("reach")):
            table.add_row(label, text)
        for anchor in said["anchors"]:
            table.add_row(f"anchor {anchor['anchor_id']}", f"{anchor['state']} {anchor.get('firmware', '')}")
    console.print(table)


def _reach(found: dict[str, Any] | None) -> list[tuple[str, str]]:
    """What the nodes can bear, by what they say of themselves."""
    if found is None:
        return []
    level = found["assurance"]
    words = f"{level} at most" + (", with a witness pad" if level > LEVEL_ALONE else "")
    rows = [("assurance of the nodes", words), *(("", each) for each in found["missing"])]
    if found["unknown"]:
        rows.append(("", f"not known of {', '.join(found['unknown'])}: not asked yet, or no answer that can be read"))
    return rows


def _drift(drift: dict[str, Any]) -> str:
    """What the anchors found when they ranged each other."""
    if drift["state"] == "ok":
        return "yes, by the anchors' ranges to each other"
    if drift["state"] == "moved":
        return f"no: anchor {drift['anchor_id']} stands about {drift['off_mm']} mm elsewhere; nothing is proved"
    return f"no: {drift['extra_sigma_mm']} mm of uncertainty are added to each anchor; commission the pad again"
