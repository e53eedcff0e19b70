"""Coverage-guided fuzzing of every codec and framing of Remote ID: no input may end in anything but `RemoteIdError`.

``make fuzz RUNS=10000000``. The first byte of an input chooses the parser; the rest is what it gets. Invariants beyond
"no other exception": what decodes is encoded and decoded again to the same message, and the tolerant reader finds a
problem exactly where the strict one refuses.
"""

from __future__ import annotations

import sys

import atheris

with atheris.instrument_imports(include=["wonderland_remote_id", "wonderland"]):
    from wonderland_remote_id import (
        Pack,
        Profile,
        RemoteIdError,
        check_operator_id,
        check_set,
        decode,
        decode_tolerant,
        encode,
        from_json,
        parse_serial_number,
        to_json,
    )
    from wonderland_remote_id.drip import Observer, Registry, parse_sam
    from wonderland_remote_id.framings import ble, captures, core_structure, hex_lines, json_feed, mavlink, wifi


def codec(data: bytes) -> None:
    """Both decoders, the encoder, the JSON form and the profiles."""
    read = decode_tolerant(data)
    for profile in Profile:
        check_set(read.messages, profile)
    try:
        decoded = decode(data)
    except RemoteIdError:
        assert read.problems
        return
    assert not read.problems
    again = decode(encode(decoded))
    assert again == decoded, (again, decoded)
    from_json(to_json(decoded))
    assert len(read.messages) == (len(decoded.messages) if isinstance(decoded, Pack) else 1)


def capture(data: bytes) -> None:
    """A capture file, cut in two."""
    reader, unwrapper = captures.CaptureReader(), captures.Unwrapper()
    for piece in (data[: len(data) // 2], data[len(data) // 2 :]):
        for packet in reader.feed(piece):
            try:
                unwrapper.frames(packet)
            except captures.CaptureError:
                raise
            except RemoteIdError:
                continue
    reader.finish()


def texts(data: bytes) -> None:
    """Serial and operator numbers."""
    text = data.decode("latin-1")
    try:
        parse_serial_number(text)
    except RemoteIdError:
        check_operator_id(text)


def authentication(data: bytes) -> None:
    """Pages of authentication messages, 25 bytes each, as one drone sends them."""
    observer = Observer(Registry({}))
    for at in range(0, len(data) - 24, 25):
        frame = bytes((0x22,)) + data[at + 1 : at + 25]
        try:
            message = decode(frame)
        except RemoteIdError:
            continue
        if not isinstance(message, Pack):
            observer.feed(frame, (message,), at)


TARGETS = (
    codec,
    capture,
    texts,
    ble.parse_advertising_data,
    ble.parse_link_layer,
    lambda data: ble.HciEvents().feed(data),
    wifi.parse_packet,
    wifi.parse_radiotap,
    mavlink.parse_datagram,
    hex_lines.parse_line,
    json_feed.parse_documents,
    core_structure.parse_core_structure,
    # The checksums of these keep a fuzzer out: give it what lies behind them.
    lambda data: mavlink.parse_datagram(_mavlink(data)),
    lambda data: ble.parse_link_layer(_link_layer(data)),
    parse_sam,
    authentication,
)


def _mavlink(data: bytes) -> bytes:
    others = (mavlink.MESSAGE_PACK, mavlink.SYSTEM_UPDATE, mavlink.ARM_STATUS)
    number = mavlink.BASIC_ID + data[0] % 6 if data and data[0] < 200 else others[data[0] % 3 if data else 0]
    payload = data[1:256]
    content = bytes((len(payload), 0, 0, 0, 1, 1)) + number.to_bytes(3, "little") + payload
    extra = mavlink.LAYOUTS[number][1]
    return b"\xfd" + content + mavlink.checksum(content + bytes((extra,))).to_bytes(2, "little")


def _link_layer(data: bytes) -> bytes:
    pdu = data[:1] + bytes((len(data[1:256]),)) + data[1:256]
    return b"\xd6\xbe\x89\x8e" + pdu + ble.crc(pdu)


def one_input(data: bytes) -> None:
    """What the fuzzer calls."""
    if not data:
        return
    try:
        TARGETS[data[0] % len(TARGETS)](data[1:])
    except RemoteIdError:
        return


def main() -> None:
    """Run libFuzzer with the arguments of the command line."""
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
