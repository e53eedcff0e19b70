"""``wonderland remote-id``: Remote ID on the command line, from whatever was captured to JSON and back."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from typing import IO, Any, Final

import click

from wonderland_remote_id.errors import FramingError, RemoteIdError
from wonderland_remote_id.framings import ble, captures, json_feed, mavlink, wifi
from wonderland_remote_id.framings.framed import Framed
from wonderland_remote_id.framings.hex_lines import format_line, parse_line
from wonderland_remote_id.profiles import Profile
from wonderland_remote_id.report import describe, error_json

MAX_LINE_BYTES: Final = 128 * 1024
MAX_PACKET_BYTES: Final = 4096
_CHUNK: Final = 1 << 16
_ADDRESS: Final = "02:00:00:00:00:01"

_READ: Final = ("frame", "ble-adv", "ble-ll", "wifi", "radiotap", "mavlink", "json")
_WRITE: Final = ("frame", "ble4", "ble5", "wifi-beacon", "wifi-nan", "mavlink")
_LINK_TYPES: Final = {
    "ble4": captures.BLE_LINK_LAYER,
    "ble5": captures.BLE_LINK_LAYER,
    "wifi-beacon": captures.WIFI,
    "wifi-nan": captures.WIFI,
}


@click.group(name="remote-id")
def remote_id() -> None:
    r"""Read and write broadcast Remote ID (ASTM F3411-22a, EN 4709-002).

    \b
    wonderland remote-id decode heard.hex                 hexadecimal frames, one on each line
    wonderland remote-id decode --pcap capture.pcapng     Wi-Fi in monitor mode, Bluetooth sniffer, btmon -w
    wonderland remote-id decode heard.hex | wonderland remote-id encode
    """


@remote_id.command()
@click.argument("file", type=click.File("rb"), default="-")
@click.option("--pcap", "is_capture", is_flag=True, help="FILE is a capture: pcap or pcapng.")
@click.option(
    "--framing",
    type=click.Choice(_READ),
    default="frame",
    show_default=True,
    help="What a line holds in hexadecimal digits: the bare frame, advertising data, a link layer packet, an "
    "802.11 frame without or with radiotap, MAVLink 2; or a JSON document of a receiver.",
)
@click.option("--tolerant", is_flag=True, help="Keep what can be read of a bad message and list its problems.")
@click.option(
    "--profile",
    type=click.Choice([profile.value for profile in Profile]),
    help="Name what breaks the rules of the EU (EN 4709-002) or the US (part 89, F3586-22).",
)
def decode(file: IO[bytes], *, is_capture: bool, framing: str, tolerant: bool, profile: str | None) -> None:
    """Write what FILE (or standard input) holds, one JSON object per line.

    A line is `[address [rssi_dBm]] frame`, the frame in hexadecimal digits. Each object has the `line` (or `packet`)
    that it comes from and either `messages` or `error`; bad input never ends the reading. Units are in the names, null
    is "unknown". The secret characters of an operator's registration are cut off.
    """
    rules = Profile(profile) if profile else None
    source = _capture(file) if is_capture else _lines(file, framing)
    for place, found in source:
        if isinstance(found, RemoteIdError):
            document = place | {"error": error_json(found)}
        else:
            document = place | describe(found, tolerant=tolerant, profile=rules)
        click.echo(json.dumps(document, ensure_ascii=False, separators=(",", ":")))


@remote_id.command()
@click.argument("file", type=click.File("rb"), default="-")
@click.option("--framing", type=click.Choice(_WRITE), default="frame", show_default=True, help="What is written.")
@click.option("--pcap", "capture", type=click.File("wb"), help="Write a capture (for all framings but frame, mavlink).")
def encode(file: IO[bytes], *, framing: str, capture: IO[bytes] | None) -> None:
    """Write the frames of JSON objects, one per line, as `decode` makes them.

    Objects that cannot be encoded (and those with an `error`) are named on standard error; the rest is written, and the
    exit status is 1.
    """
    if capture is not None:
        if framing not in _LINK_TYPES:
            raise click.UsageError(f"--pcap needs a --framing of {', '.join(_LINK_TYPES)}")
        capture.write(captures.pcap_header(_LINK_TYPES[framing]))
    failed = 0
    for number, line in _bounded_lines(file):
        try:
            for index, framed in enumerate(_documents(line)):
                packet = _wrap(framed, framing, framed.counter if framed.counter is not None else number + index)
                if capture is not None:
                    capture.write(captures.pcap_record(packet, framed.t_ms or 0))
                elif framing == "frame":
                    click.echo(format_line(packet, framed.address, framed.rssi_dbm))
                else:
                    click.echo(packet.hex())
        except RemoteIdError as error:
            failed += 1
            click.echo(f"line {number}: {error}", err=True)
    if failed:
        click.echo(f"{failed} lines could not be encoded", err=True)
        sys.exit(1)


def _bounded_lines(file: IO[bytes]) -> Iterator[tuple[int, bytes | FramingError]]:
    """Lines that are not blank, by number from 1; an error stands for one that is too long."""
    number = 0
    while line := file.readline(MAX_LINE_BYTES):
        number += 1
        if len(line) == MAX_LINE_BYTES and not line.endswith(b"\n"):
            while (rest := file.readline(MAX_LINE_BYTES)) and not rest.endswith(b"\n"):
                pass
            yield number, FramingError(f"a line of more than {MAX_LINE_BYTES} bytes")
        elif line.strip():
            yield number, line


def _lines(file: IO[bytes], framing: str) -> Iterator[tuple[dict[str, Any], Framed | RemoteIdError]]:
    unwrap = _unwrapper(framing)
    for number, line in _bounded_lines(file):
        place = {"line": number}
        try:
            found = unwrap(_checked(line))
        except RemoteIdError as error:
            yield place, error
            continue
        if not found:
            yield place, FramingError(f"holds no Remote ID in framing {framing}")
        for one in found:
            yield place, one


def _unwrapper(framing: str) -> Callable[[bytes], list[Framed | RemoteIdError]]:
    """What finds the frames in one line."""
    if framing == "json":
        return lambda line: list(json_feed.parse_documents(line))
    stream = mavlink.MavlinkStream()
    parsers: dict[str, Callable[[bytes], list[Framed]]] = {
        "ble-adv": ble.parse_advertising_data,
        "ble-ll": ble.parse_link_layer,
        "wifi": wifi.parse_packet,
        "radiotap": wifi.parse_radiotap,
    }

    def unwrap(line: bytes) -> list[Framed | RemoteIdError]:
        if framing == "frame":
            parsed = parse_line(line)
            return [Framed(parsed.frame, "hex", address=parsed.address, rssi_dbm=parsed.rssi_dbm)]
        packet = parse_line(line, MAX_PACKET_BYTES).frame
        return list(stream.feed(packet)) if framing == "mavlink" else list(parsers[framing](packet))

    return unwrap


def _checked(line: bytes | FramingError) -> bytes:
    if isinstance(line, FramingError):
        raise line
    return line


def _capture(file: IO[bytes]) -> Iterator[tuple[dict[str, Any], Framed | RemoteIdError]]:
    reader, unwrapper = captures.CaptureReader(), captures.Unwrapper()
    number = 0
    try:
        while data := file.read(_CHUNK):
            for packet in reader.feed(data):
                number = packet.number
                try:
                    found = unwrapper.frames(packet)
                except RemoteIdError as error:
                    yield {"packet": number}, error
                else:
                    for one in found:
                        yield {"packet": number}, one
        reader.finish()
    except captures.CaptureError as error:
        # Nothing after this place can be found; what came before has been written.
        yield {"packet": number + 1}, error


def _documents(line: bytes | FramingError) -> list[Framed]:
    framed = []
    for document in json_feed.split_documents(_checked(line)):
        if isinstance(document, dict) and "error" in document:
            raise FramingError("an error that decode reported; there is no message in it")
        framed += json_feed.parse_document(document)
    return framed


def _wrap(framed: Framed, framing: str, counter: int) -> bytes:
    address = framed.address or _ADDRESS
    if framing == "ble4":
        return ble.link_layer_packet(framed.frame, counter, address)
    if framing == "ble5":
        return ble.link_layer_packet(framed.frame, counter, address, extended=True)
    if framing == "wifi-beacon":
        return wifi.beacon(framed.frame, counter, address)
    if framing == "wifi-nan":
        return wifi.nan_action(framed.frame, counter, address)
    if framing == "mavlink":
        return mavlink.build_frame(framed.frame, address=framed.address, sequence=counter)
    return framed.frame
