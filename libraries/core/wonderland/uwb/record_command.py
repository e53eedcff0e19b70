"""``wonderland uwb record``: what boards measure, as a recording for ``wonderland pad commission``."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import sys
from pathlib import Path
from typing import Final

import click

from wonderland.clock import SteadyClock
from wonderland.uwb import listen as bench
from wonderland.uwb.commands import key_of, short_address
from wonderland.uwb.port_options import PORT
from wonderland.uwb.port_options import baud_rate as with_baud_rate
from wonderland.uwb.port_options import rtscts as with_rtscts
from wonderland.uwb.record import Recorder, Reports
from wonderland.uwb.record import record as write
from wonderland_fira_uci.dwm1001 import Mode
from wonderland_fira_uci.errors import UwbError
from wonderland_fira_uci.serial_port import serial_opener, url_problem

INTERVAL_MS: Final = 100


@click.command()
@click.option("--kind", required=True, type=click.Choice(("dwm1001", "uci")), help="What the boards speak.")
@click.option(
    "--board",
    "boards",
    multiple=True,
    metavar="ANCHOR=PORT",
    help="A board of the pad that measures its own range to --peer; once for each anchor (DWM1001 tags).",
)
@click.option("--peer", metavar="HEX", help="With --board: short address of the drone's board.")
@click.option(
    "--port", type=PORT, help="In place of --board: the drone's board, which measures its range to each anchor."
)
@click.option(
    "--anchor", "anchors", multiple=True, metavar="ANCHOR=HEX", help="With --port: an anchor's short address."
)
@click.option("--mac", metavar="HEX", help="With --port, UCI: the drone's board's own address.")
@with_baud_rate
@with_rtscts
@click.option("--key-file", type=click.Path(dir_okay=False, path_type=Path), help="UCI: the session's key.")
@click.option("--interval-ms", type=click.IntRange(20, 60_000), default=INTERVAL_MS, show_default=True, help="UCI.")
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="CSV",
    help="Where the ranges are written.",
)
@click.option("--seconds", type=click.FloatRange(0.1), help="How long; otherwise Ctrl-C ends it.")
def record(
    *,
    kind: str,
    boards: tuple[str, ...],
    peer: str | None,
    port: str | None,
    anchors: tuple[str, ...],
    mac: str | None,
    baud_rate: int,
    rtscts: bool,
    key_file: Path | None,
    interval_ms: int,
    out: Path,
    seconds: float | None,
) -> None:
    """Write what boards measure as a recording: t (s), anchor, range (m), nlos.

    \b
      wonderland uwb record --kind dwm1001 --board A1=/dev/ttyACM0 --board A2=/dev/ttyACM1 --board A3=/dev/ttyACM2 \\
          --board A4=/dev/ttyACM3 --peer 1a2b --out ranges.csv
      wonderland uwb record --kind uci --port /dev/ttyUSB0 --mac d001 --anchor A1=a001 --anchor A2=a002 --out ranges.csv
      wonderland pad commission --recording ranges.csv --reference truth.csv --anchors anchors.csv --out record.json

    Exit code 1 when a board does not report, or not one range was written.
    """  # noqa: D301 - \b is click's mark for "do not wrap"
    if bool(boards) == bool(port):
        raise click.UsageError("give --board for each of the pad's boards, or --port for the drone's")
    clock = SteadyClock()
    sources: dict[str, tuple[Reports, dict[str, str]]] = {}
    if boards:
        if kind != "dwm1001" or peer is None:
            raise click.UsageError(
                "--board is for DWM1001 tags and needs --peer; wonderland pad commission records a pad's UCI nodes"
            )
        drone = f"{short_address(peer):04x}"
        for name, where in _pairs("--board", boards).items():
            problem = url_problem(where)
            if problem:
                raise click.UsageError(f"--board {name}={where}: {problem}")
            opener = serial_opener(where, baud_rate, rtscts=rtscts)
            sources[name] = (bench.dwm1001(where, opener, Mode.TLV, clock), {drone: name})
    else:
        assert port is not None
        names = {f"{short_address(text):04x}": name for name, text in _pairs("--anchor", anchors).items()}
        if not names:
            raise click.UsageError("--port needs --anchor NAME=ADDRESS, once for each anchor")
        opener = serial_opener(port, baud_rate, rtscts=rtscts)
        if kind == "dwm1001":
            sources[port] = (bench.dwm1001(port, opener, Mode.TLV, clock), names)
        elif mac is None:
            raise click.UsageError("--kind uci needs --mac, the board's own address")
        else:
            plan = bench.UciBench(
                mac=short_address(mac),
                peers=tuple(int(address, 16) for address in names),
                leads=True,
                interval_ms=interval_ms,
                key=key_of(key_file),
            )
            sources[port] = (bench.uci(port, opener, plan, clock), names)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)  # of ports that cannot be opened
    try:
        recorder = Recorder(out)
        asyncio.run(_until_stopped(sources, recorder, seconds))
    except UwbError as error:
        raise click.ClickException(str(error)) from error
    if not recorder.rows:
        raise click.ClickException("not one range was written; do the boards hear each other, with these addresses?")
    for name, count in sorted(recorder.rows.items()):
        click.echo(f"{name}: {count} ranges")


def _pairs(option: str, texts: tuple[str, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not (name and sign and value):
            raise click.UsageError(f"{option} {text}: is not ANCHOR=…")
        if name in found:
            raise click.UsageError(f"{option}: {name} is there twice")
        found[name] = value
    return found


async def _until_stopped(
    sources: dict[str, tuple[Reports, dict[str, str]]], recorder: Recorder, seconds: float | None
) -> None:
    task = asyncio.create_task(write(sources, recorder, seconds))
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
