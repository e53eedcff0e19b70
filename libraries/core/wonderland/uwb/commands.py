"""``wonderland uwb``: try a UWB board at the bench."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import json
import logging
import signal
import sys
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from wonderland.lazy_commands import LazyGroup
from wonderland.uwb.port_options import PORT, baud_rate, rtscts

if TYPE_CHECKING:
    from wonderland.uwb.listen import Document, Summary, UciBench

if importlib.util.find_spec("serial") is None:  # a machine without serial ports does not show this command
    raise ModuleNotFoundError("pyserial is not installed; the extras edge and uav bring it", name="serial")

MAX_KEY_FILE_OCTETS: Final = 256
KINDS: Final = ("dwm1001", "uci")
ADDRESSES: Final = range(0x0001, 0xFFFE)
"""0 is nobody's, fffe and ffff are everybody's."""
MODES: Final = ("tlv", "les", "lec", "lep")


_VIRTUAL: Final = (
    {"virtual": ("wonderland_simulator.virtual_command:virtual", "Ports with virtual boards, to try things without.")}
    if importlib.util.find_spec("wonderland_simulator") is not None  # only where the simulator is installed
    else {}
)


@click.group(
    cls=LazyGroup,
    lazy={
        **_VIRTUAL,
        "prepare": ("wonderland.uwb.prepare_command:prepare", "Put a DWM1001 into its role, and check it."),
        "law": ("wonderland.uwb.law_command:law", "What radio law says about UWB at a landing pad."),
        "udev": ("wonderland.uwb.udev_command:udev", "Print the udev rule that gives a board a name."),
        "record": ("wonderland.uwb.record_command:record", "Write what boards measure as a recording (CSV)."),
    },
)
def uwb() -> None:
    """Try UWB boards: what one measures, how often, how steadily; put boards into their roles; record.

    \b
      wonderland uwb listen --port /dev/ttyACM0 --kind dwm1001
      wonderland uwb capabilities --port /dev/ttyUSB0
      wonderland uwb prepare --port /dev/ttyACM0 --role pad --network 3caf
      wonderland uwb listen --port /dev/ttyUSB0 --kind uci --mac a001 --peer d001 --lead
    """  # noqa: D301 - \b is click's mark for "do not wrap"


def short_address(text: str) -> int:
    """The address of one board in hexadecimal digits. Raises BadParameter."""
    number = sixteen_bits(text, "short address")
    if number not in ADDRESSES:
        raise click.BadParameter(f"{text!r} is no address of one board; 0001 to fffd are")
    return number


def sixteen_bits(text: str, what: str) -> int:
    """A number in hexadecimal digits; ``what`` it is, for who mistypes it. Raises BadParameter."""
    digits = text.lower().removeprefix("0x")
    if not 1 <= len(digits) <= 4 or any(digit not in "0123456789abcdef" for digit in digits):
        raise click.BadParameter(f"{text!r} is no {what}; give up to four hexadecimal digits, for example d001")
    return int(digits, 16)


@uwb.command()
@click.option(
    "--port",
    required=True,
    type=PORT,
    help="Port of the board, which speaks FiRa UCI: a device or socket://, rfc2217://.",
)
@baud_rate
@rtscts
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def capabilities(*, port: str, baud_rate: int, rtscts: bool, as_json: bool) -> None:
    """Say what a board can do by its own word, and which assurance that bears on a pad and on a drone.

    Exit code 1 when the board does not answer, or not in a way that can be read.
    """
    from wonderland.uwb.listen import capabilities_of  # noqa: PLC0415 - `--help` needs none of it
    from wonderland_fira_uci.errors import UwbError  # noqa: PLC0415
    from wonderland_fira_uci.serial_port import serial_opener  # noqa: PLC0415

    logging.basicConfig(level=logging.WARNING, format="%(message)s", stream=sys.stderr)
    try:
        document = asyncio.run(capabilities_of(port, serial_opener(port, baud_rate, rtscts=rtscts)))
    except UwbError as error:
        raise click.ClickException(str(error)) from error
    if document is None:
        raise click.ClickException(f"{port}: the board gave no answer that says what it can do")
    if as_json:
        click.echo(json.dumps(document))
        return
    for name, value in document["capabilities"].items():
        text = ", ".join(map(str, value)) if isinstance(value, list) else value
        click.echo(f"{name.replace('_', ' ')}: {'not told' if text is None else text if text != '' else 'none'}")
    for place in ("pad", "drone"):
        click.echo(f"On a {place}: assurance {document[place]['assurance']} at most")
        for line in document[place]["missing"]:
            click.echo(f"  {line}")


@uwb.command()
@click.option(
    "--port",
    required=True,
    type=PORT,
    help="Port of the board: a device, socket://HOST:PORT or rfc2217://HOST:PORT.",
)
@baud_rate
@rtscts
@click.option("--kind", required=True, type=click.Choice(KINDS), help="What the board speaks.")
@click.option(
    "--mode",
    type=click.Choice(MODES),
    default="tlv",
    show_default=True,
    help="DWM1001: ask for each round, or let its shell stream lines.",
)
@click.option("--mac", help="UCI: this board's short address, hexadecimal.")
@click.option("--peer", "peers", multiple=True, help="UCI: a peer's short address; may be repeated.")
@click.option("--lead/--follow", default=True, show_default=True, help="UCI: controller and initiator, or the other.")
@click.option("--session", type=click.IntRange(1, 0xFFFFFFFF), default=1, show_default=True, help="UCI: session id.")
@click.option("--channel", type=int, default=9, show_default=True, help="UCI: channel.")
@click.option(
    "--slot-ms", type=click.FloatRange(0.3, 20.0), default=2.0, show_default=True, help="UCI: length of a slot."
)
@click.option("--interval-ms", type=click.IntRange(20, 60_000), default=200, show_default=True, help="UCI: interval.")
@click.option(
    "--key-file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="UCI: file with the session key in hexadecimal (provisioned STS). Without it the public static STS is used.",
)
@click.option("--blink", is_flag=True, help="UCI: blink, too, for nodes that time-stamp (a pad's calibration run).")
@click.option(
    "--responders",
    type=click.IntRange(1, 8),
    help="UCI: how many boards answer in a round, where this one follows a board that leads several.",
)
@click.option("--count", type=click.IntRange(1), help="Stop after so many reports.")
@click.option("--seconds", type=click.FloatRange(0.1), help="Stop after so long. Otherwise Ctrl-C ends it.")
@click.option("--json", "as_json", is_flag=True, help="A JSON document per line; the last one is the summary.")
def listen(*, port: str, kind: str, count: int | None, seconds: float | None, as_json: bool, **options: Any) -> None:
    """Print what a board measures, and at the end count, rate, mean and spread of the ranges to each peer.

    Exit code 1 when the board does not report, 0 otherwise.
    """
    from wonderland_fira_uci.errors import UwbError  # noqa: PLC0415 - `--help` needs none of it

    # A board that goes and comes says so in the log.
    logging.basicConfig(level=logging.WARNING if as_json else logging.INFO, format="%(message)s", stream=sys.stderr)
    try:
        summary = asyncio.run(_listen(_reports(port, kind, **options), count, seconds, as_json=as_json))
    except UwbError as error:
        raise click.ClickException(str(error)) from error
    if not summary.ready:
        raise click.ClickException(f"{port}: not one report; is the board there, and of this kind?")
    if as_json:
        click.echo(json.dumps(summary.document()))
    else:
        _show(summary)


def _reports(
    port: str,
    kind: str,
    *,
    mode: str,
    mac: str | None,
    peers: tuple[str, ...],
    lead: bool,
    session: int,
    channel: int,
    slot_ms: float,
    interval_ms: int,
    key_file: Path | None,
    blink: bool,
    responders: int | None,
    baud_rate: int,
    rtscts: bool,
) -> AsyncGenerator[Document, None]:
    from wonderland.clock import SteadyClock  # noqa: PLC0415 - `--help` needs none of it
    from wonderland.uwb import listen as bench  # noqa: PLC0415
    from wonderland_fira_uci.dwm1001 import Mode  # noqa: PLC0415
    from wonderland_fira_uci.serial_port import serial_opener  # noqa: PLC0415

    opener = serial_opener(port, baud_rate, rtscts=rtscts)

    if kind == "dwm1001":
        return bench.dwm1001(port, opener, Mode(mode), SteadyClock())
    if mac is None or not peers:
        raise click.UsageError("--kind uci needs --mac (this board) and --peer (the others)")
    own, others = short_address(mac), tuple(short_address(peer) for peer in peers)
    if len({own, *others}) != 1 + len(others):
        raise click.UsageError("--mac and --peer: two boards have the same address")
    if blink and not (lead and key_file):
        raise click.UsageError("--blink is for the board that leads, with the run's key (--lead, --key-file)")
    session_plan: UciBench = bench.UciBench(
        mac=own,
        peers=others,
        leads=lead,
        session_id=session,
        channel=channel,
        slot_us=round(slot_ms * 1_000),
        interval_ms=interval_ms,
        key=key_of(key_file),
        blink=blink,
        responders=responders or 0,
    )
    return bench.uci(port, opener, session_plan, SteadyClock())


def key_of(path: Path | None) -> bytes | None:
    """The session key of a file with hexadecimal digits."""
    if path is None:
        return None
    try:
        with path.open("rb") as file:
            text = file.read(MAX_KEY_FILE_OCTETS)
        key = bytes.fromhex(text.decode("ascii"))
    except OSError as error:
        raise click.UsageError(f"--key-file {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise click.UsageError(f"--key-file {path}: holds no hexadecimal digits alone") from error
    if len(key) not in {16, 32}:
        raise click.UsageError(f"--key-file {path}: {len(key)} octets; a session key has 16 or 32")
    return key


async def _listen(
    reports: AsyncGenerator[Document, None], count: int | None, seconds: float | None, *, as_json: bool
) -> Summary:
    from wonderland.uwb.listen import Summary  # noqa: PLC0415 - `--help` needs none of it

    summary = Summary()

    async def work() -> None:
        async with contextlib.aclosing(reports):
            async for document in reports:
                summary.add(document)
                click.echo(json.dumps(document) if as_json else _line(document))
                if count is not None and summary.rounds >= count:
                    return

    task = asyncio.create_task(work())
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, task.cancel)
    _, late = await asyncio.wait({task}, timeout=seconds)
    for unfinished in late:
        unfinished.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    return summary


def _line(document: Document) -> str:
    match document["kind"]:
        case "ready":
            return f"{document['board']} is ready, firmware {document['firmware']}"
        case "lost":
            return f"away: {document['detail']}"
        case "heard":
            return f"{document['address']} says it is at {_place(document.get('position'))}"
        case _:
            rows = "  ".join(_row(row) for row in document["ranges"]) or "nobody heard"
            place = f"  at {_place(document['position'])}" if "position" in document else ""
            return rows + place + ("  (damaged line)" if document.get("damaged") else "")


def _row(row: Document) -> str:
    if "range_mm" not in row:
        return f"{row['address']} – {row.get('status', '')}".rstrip()
    return f"{row['address']} {row['range_mm'] / 1000:7.3f} m"


def _place(position: Document | None) -> str:
    if position is None:
        return "no known place"
    return ", ".join(f"{position[axis] / 1000:.2f}" for axis in ("x_mm", "y_mm", "z_mm")) + " m"


def _show(summary: Summary) -> None:
    from rich.table import Table  # noqa: PLC0415

    from wonderland.consoles import for_people  # noqa: PLC0415 - `--help` needs none of it

    table = Table(title=f"{summary.rounds} reports, {summary.damaged} of them damaged")
    for name in ("peer", "ranges", "missing", "per second", "mean, m", "σ, mm"):
        table.add_column(name, justify="right")
    for address, tally in sorted(summary.peers.items()):
        table.add_row(
            address,
            str(tally.count),
            str(tally.missing),
            f"{tally.rate_hz:.1f}",
            f"{tally.mean_mm / 1000:.3f}" if tally.count else "–",
            f"{tally.sigma_mm:.0f}" if tally.count > 1 else "–",
        )
    for_people().print(table)
