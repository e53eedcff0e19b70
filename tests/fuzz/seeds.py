"""Valid inputs to begin with: ``python tests/fuzz/seeds.py DIRECTORY`` writes one for each target of the fuzzer."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from wonderland_remote_id import BasicId, Location, Pack, encode
from wonderland_remote_id.framings import ble, captures, mavlink, wifi

PACK = encode(Pack(messages=(BasicId(uas_id="1581F5FKD229400A1234"), Location(lat_e7=1, lon_e7=2))))
ADDRESS = "02:00:00:00:00:01"


def seeds() -> dict[int, bytes]:
    """One valid input for each target, by its number in the fuzzer."""
    beacon = wifi.beacon(PACK, 1, ADDRESS)
    return {
        0: PACK,
        1: captures.pcap_header(105) + captures.pcap_record(beacon, 0),
        2: b"1581F5FKD229400A1234",
        3: ble.advertising_data(PACK, 1),
        4: ble.link_layer_packet(PACK, 1, ADDRESS, extended=True),
        6: wifi.nan_action(PACK, 1, ADDRESS),
        7: wifi.radiotap(beacon, -60),
        8: mavlink.build_frame(PACK),
        9: b"02:00:00:00:00:01 -60 " + PACK.hex().encode(),
        10: json.dumps({"Basic ID": {"id": "X"}, "Location/Vector Message": {"latitude": 1, "longitude": 2}}).encode(),
        11: bytes(920),
        12: b"\x01" + bytes(50),
    }


def write(directory: Path) -> None:
    """The seeds as files; the first byte of each is its target's number."""
    directory.mkdir(parents=True, exist_ok=True)
    for number, seed in seeds().items():
        (directory / f"seed-{number}").write_bytes(bytes((number,)) + seed)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
