"""``wonderland pad status``: how a pad is, by the file that its agent writes."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from wonderland.consoles import for_people
from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.config_option import config_option
from wonderland_edge_agent.health import read_status
from wonderland_edge_agent.settings import load
from wonderland_edge_agent.spool.errors import SpoolError
from wonderland_edge_agent.spool.lock import LOCK_NAME, holder_of
from wonderland_fabric_gateway.errors import LedgerError

STALE_S = 30
CANNOT_PROVE = 3
"""Exit code of ``pad status``; 2 is click's, for wrong options."""
NOT_KNOWN = 4
"""Nothing speaks against it, and nothing has shown that the anchors range."""
_STATES = {0: "can prove", CANNOT_PROVE: "cannot prove", NOT_KNOWN: "not known whether it can prove"}
LEVEL_ALONE = 3
"""Highest assurance that a pad reaches by itself."""


@click.command()
@config_option
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def status(*, path: Path, as_json: bool) -> None:
    """Say how the pad is.

    Exit code 0: it can prove; 1: its agent does not run; 3: it runs and cannot prove, or has not looked yet whether its
    anchors range; 4: nothing speaks against it, but its anchors do not hear one another, so that only a drone will show
    whether they range.

    One that has said nothing for half a minute hangs, and counts as not running, too.
    """
    try:
        settings = load(path)
        said = read_status(settings.status_file)
        running = _runs(settings.status_file, said)
    except (SettingsError, LedgerError, SpoolError) as error:
        raise click.ClickException(str(error)) from error
    age_s = _age_s(said)
    alive = running and age_s <= STALE_S
    if as_json:
        click.echo(json.dumps({**said, "alive": alive, "running": running, "age_s": round(min(age_s, 1e9), 1)}))
    else:
        _show(said, _STATES[_exit_code(said)] if alive else _dead(age_s, running=running))
    sys.exit(_exit_code(said) if alive else 1)


def _exit_code(said: dict[str, Any]) -> int:
    if said.get("accepts_sessions") is not True:
        return CANNOT_PROVE
    return NOT_KNOWN if said.get("not_known") else 0


def is_alive(status_file: Path) -> bool:
    """Whether the agent that writes this status file runs, and has written it lately."""
    try:
        said = read_status(status_file)
        return _runs(status_file, said) and _age_s(said) <= STALE_S
    except (LedgerError, SpoolError):
        return False


def _runs(status_file: Path, said: dict[str, Any]) -> bool:
    """Whether the process that wrote this still holds the spool: a lock that the kernel takes back from the dead.

    Raises SpoolError.
    """
    holder = holder_of(status_file.with_name(LOCK_NAME))
    return holder is not None and holder in {"", str(said.get("process"))}


def _dead(age_s: float, *, running: bool) -> str:
    if running:
        return f"its agent hangs: silent for {age_s:.0f} s"
    return f"not running (what follows it said {age_s:.0f} s ago)" if math.isfinite(age_s) else "not running"


def _age_s(said: dict[str, Any]) -> float:
    t_ms = said.get("t_ms")
    return time.time() - t_ms / 1000 if isinstance(t_ms, int) else float("inf")


def _show(said: dict[str, Any], state: str) -> None:
    console = for_people()
    console.print(f"Pad {said.get('pad_id', '?')}: {state}", soft_wrap=True)
    for reason in (*_listed(said, "cannot_prove"), *_listed(said, "not_known"), *_listed(said, "not_for")):
        console.print(f"  {reason}", soft_wrap=True, markup=False, highlight=False)
    without = _listed(said, "goes_on_without")
    if without:
        words = ", ".join(without)
        console.print(f"  goes on without {words}", soft_wrap=True, markup=False, highlight=False)
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
            words = f"{anchor['state']} {anchor.get('detail') or anchor.get('firmware', '')}"
            table.add_row(f"anchor {anchor['anchor_id']}", escape(words))
    console.print(table)


def _listed(said: dict[str, Any], name: str) -> list[str]:
    found = said.get(name)
    return [str(each) for each in found] if isinstance(found, list) else []


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
