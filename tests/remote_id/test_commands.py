"""``wonderland remote-id``: one JSON object for each line, errors included, and back."""

from __future__ import annotations

import doctest
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import wonderland_remote_id as package
from wonderland_remote_id import BasicId, Location, OperatorId, Pack, encode
from wonderland_remote_id.commands import MAX_LINE_BYTES, remote_id
from wonderland_remote_id.framings import captures, wifi

SERIAL = encode(BasicId(uas_id="1581F5FKD229400A1234"))
PLACE = encode(Location(lat_e7=604_518_000, lon_e7=222_666_000))
PACK = encode(Pack(messages=(BasicId(uas_id="1581F5FKD229400A1234"), Location(lat_e7=604_518_000, lon_e7=222_666_000))))


def run(*arguments: str, data: bytes | str = b"") -> tuple[int, str, str]:
    result = CliRunner().invoke(remote_id, arguments, input=data, catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


def decode(*arguments: str, data: bytes | str = b"") -> list[dict]:
    code, out, _ = run("decode", *arguments, data=data)
    assert code == 0
    return [json.loads(line) for line in out.splitlines()]


def test_decode_says_every_line_and_never_stops() -> None:
    data = b"\n".join([SERIAL.hex().encode(), b"", b"zz", b"02:00:00:00:00:01 -60 " + PLACE.hex().encode(), b"\xff\xfe",
                       b"9" * (MAX_LINE_BYTES + 10), b"92" + bytes(48), PACK.hex().encode()])  # fmt: skip
    said = decode(data=data)
    assert [entry["line"] for entry in said] == [1, 3, 4, 5, 6, 7, 8]
    assert ["error" in entry for entry in said] == [False, True, False, True, True, True, False]
    assert (said[2]["address"], said[2]["rssi_dbm"], said[2]["messages"][0]["lat_e7"]) == (
        "02:00:00:00:00:01",
        -60,
        604_518_000,
    )
    assert said[6]["pack"]
    assert said[2]["messages"][0]["speed_mm_s"] is None


def test_tolerant_and_profile() -> None:
    bad = bytearray(PLACE)
    bad[5:9] = (910_000_000).to_bytes(4, "little")
    [strict] = decode(data=bad.hex())
    assert strict["error"]["field"] == "latitude"
    assert strict["error"]["offset"] == 5
    [tolerant] = decode("--tolerant", "--profile", "eu", data=bad.hex())
    assert tolerant["messages"][0]["lat_e7"] is None
    assert tolerant["problems"][0]["field"] == "latitude"
    assert "eu.height.missing" in {violation["rule"] for violation in tolerant["violations"]}
    [pack] = decode("--profile", "us", data=PACK.hex())
    assert "us.system.missing" in {violation["rule"] for violation in pack["violations"]}


def test_the_secret_of_a_registration_is_not_written() -> None:
    code, out, _ = run("decode", "--profile", "eu", data=encode(OperatorId(operator_id="FIN87astrdge12k8-xyz")).hex())
    assert code == 0
    assert "FIN87astrdge12k8" in out
    assert "xyz" not in out


@pytest.mark.parametrize("framing", ["ble4", "ble5", "wifi-beacon", "wifi-nan"])
def test_captures_both_ways(framing, tmp_path: Path) -> None:
    lines = json.dumps(
        {"messages": [json.loads(run("decode", data=PLACE.hex())[1])["messages"][0]], "t_ms": 1_800_000_000_123}
    )
    target = tmp_path / "heard.pcap"
    assert run("encode", "--framing", framing, "--pcap", str(target), data=lines)[0] == 0
    [said] = decode("--pcap", str(target))
    assert (said["packet"], said["t_ms"], said["transport"]) == (1, 1_800_000_000_123, framing)
    assert said["messages"][0]["lat_e7"] == 604_518_000
    target.write_bytes(target.read_bytes() + b"\xff" * 40)
    assert ["error" in entry for entry in decode("--pcap", str(target))] == [False, True]


def test_a_capture_with_a_broken_packet_is_read_to_its_end(tmp_path: Path) -> None:
    good, broken = wifi.beacon(PACK, 1, "02:00:00:00:00:01"), wifi.beacon(PLACE, 1, "02:00:00:00:00:01")[:-10]
    target = tmp_path / "heard.pcap"
    target.write_bytes(
        captures.pcap_header(105) + b"".join(captures.pcap_record(data, 0) for data in (good, broken, bytes(50), good))
    )
    said = decode("--pcap", str(target))
    assert [(entry["packet"], "error" in entry) for entry in said] == [(1, False), (2, True), (4, False)]


@pytest.mark.parametrize("framing", ["frame", "ble4", "ble5", "wifi-beacon", "wifi-nan", "mavlink"])
def test_encode_is_the_inverse(framing) -> None:
    back = {
        "frame": "frame",
        "ble4": "ble-ll",
        "ble5": "ble-ll",
        "wifi-beacon": "wifi",
        "wifi-nan": "wifi",
        "mavlink": "mavlink",
    }
    first = run("decode", data=f"{SERIAL.hex()}\n02:00:00:00:00:01 -60 {PLACE.hex()}\n")[1]
    code, packets, _ = run("encode", "--framing", framing, data=first)
    assert code == 0
    said = decode("--framing", back[framing], data=packets)
    assert [entry["messages"] for entry in said] == [json.loads(line)["messages"] for line in first.splitlines()]
    if framing == "frame":
        assert packets == f"{SERIAL.hex()}\n02:00:00:00:00:01 -60 {PLACE.hex()}\n"


def test_encode_names_what_it_cannot_write() -> None:
    said = run("decode", data=f"{SERIAL.hex()}\nzz\n")[1]
    code, out, err = run("encode", data=said + '{"type": "location", "lat_e7": 900000001, "lon_e7": 0}\nnothing\n')
    assert code == 1
    assert out == f"{SERIAL.hex()}\n"
    assert "line 2" in err
    assert "latitude" in err
    assert "3 lines" in err
    assert run("encode", "--pcap", "-", data=said)[0] == 2


def test_json_of_receivers() -> None:
    said = decode("--framing", "json", data='{"Basic ID": {"id": "ABC", "id_type": "Serial"}}\n{"sn": 1}\n{\n')
    assert [list(entry)[-1] for entry in said] == ["messages", "error", "error"]


def test_the_example_of_the_documentation_runs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "remote-id.md").read_text()
    example = page.split("```python\n", 1)[1].split("```", 1)[0]
    failed, tried = doctest.DocTestRunner().run(doctest.DocTestParser().get_doctest(example, {}, "remote-id", None, 0))
    assert (failed, tried) == (0, 3)
    failed, tried = doctest.testmod(package)
    assert failed == 0
    assert tried
