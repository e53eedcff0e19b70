"""pad.toml: every complaint names the field."""

from __future__ import annotations

import contextlib
import json
import os
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.commands import pad
from wonderland_edge_agent.settings import load, parse
from wonderland_edge_agent.spool.lock import LOCK_NAME, ProcessLock
from wonderland_uav_agent.commands import uav

GOOD = """
pad_id = "pad-1"
connection = "ledger/connection.json"
spool = "spool"
permission_command = ["/usr/local/bin/lights", "pad-1"]

[[anchors]]
anchor_id = "A1"
port = "/dev/ttyUSB0"
[[anchors]]
anchor_id = "A2"
port = "/dev/ttyUSB1"
[[anchors]]
anchor_id = "A3"
port = "/dev/ttyUSB2"

[remote_id]
listen = "[::]:5480"

[backend]
url = "wss://console.example/ingest"
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "pad.toml"
    path.write_text(GOOD)
    return path


@pytest.mark.parametrize(
    ("line", "choices"),
    [
        ('[uwb]\nregion = "eu"', "uwb.region is 'eu', which is not known; EU, JP, UK, US are"),
        ('[uwb]\nwords = "none"', "both_ways, initiator are"),
        ('[[anchors]]\nanchor_id = "A4"\nport = "/dev/x"\nflow_control = "xonxoff"', "none, rtscts are"),
    ],
)
def test_a_word_that_is_none_of_the_choices_is_answered_with_them(tmp_path, line, choices):
    path = tmp_path / "pad.toml"
    path.write_text(GOOD + line)
    with pytest.raises(SettingsError) as caught:
        load(path)
    assert choices in str(caught.value)


def test_a_good_file_is_read_with_paths_relative_to_it(file):
    settings_ = load(file)
    assert settings_.connection == file.parent / "ledger" / "connection.json"
    assert settings_.spool == file.parent / "spool"
    assert settings_.identity == "pad"
    assert [anchor.port for anchor in settings_.anchors] == ["/dev/ttyUSB0", "/dev/ttyUSB1", "/dev/ttyUSB2"]
    assert settings_.remote_id.listen == ("::", 5480)
    assert settings_.quota_bytes == 64 << 20


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        ('pad_id = "pad-1"', "", "pad_id is missing"),
        ('pad_id = "pad-1"', "pad_id = 7", "pad_id is 7, expected a text"),
        ('pad_id = "pad-1"', 'pad_id = "päd"', "pad_id is 'päd'"),
        ('spool = "spool"', 'spool = ""', "spool is empty"),
        ('anchor_id = "A2"', 'anchor_id = "A1"', "same anchor_id"),
        ('port = "/dev/ttyUSB2"', 'port = "/dev/ttyUSB1"', "same port"),
        ('[[anchors]]\nanchor_id = "A3"\nport = "/dev/ttyUSB2"', "", "anchors has 2 entries"),
        ('port = "/dev/ttyUSB1"', 'device = "/dev/ttyUSB1"', r"anchors\[1\].device is unknown"),
        ('listen = "[::]:5480"', 'listen = "5480"', "remote_id.listen is not host:port"),
        ('listen = "[::]:5480"', 'listen = "0.0.0.0:99999"', "remote_id.listen"),
        ('url = "wss', 'url = "https', "backend.url"),
        ('url = "wss', 'utl = "wss', "backend.utl is unknown"),
        ('pad_id = "pad-1"', 'pad_id = "pad-1"\nquota_mb = 0', "quota_mb is 0"),
        ('pad_id = "pad-1"', 'pad_id = "pad-1"\nprekeys = true', "prekeys is True"),
        (
            'pad_id = "pad-1"',
            'pad_id = "pad-1"\nwhole_certificate = "yes"',
            "whole_certificate is 'yes', expected true or false",
        ),
        ('pad_id = "pad-1"', "pad_id = ", "no TOML"),
    ],
)
def test_a_mistake_is_named(file, before, after, complaint):
    assert before in GOOD
    file.write_text(GOOD.replace(before, after))
    with pytest.raises(SettingsError, match=complaint):
        load(file)


def test_a_missing_huge_or_binary_file_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="cannot be read"):
        load(tmp_path / "none.toml")
    (tmp_path / "huge.toml").write_bytes(b"#" * 300_000)
    with pytest.raises(SettingsError, match="larger"):
        load(tmp_path / "huge.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match="no TOML"):
        load(tmp_path / "binary.toml")


values = st.recursive(
    st.one_of(st.text(max_size=12), st.integers(), st.booleans(), st.floats(allow_nan=False)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
names = st.sampled_from(
    ["pad_id", "connection", "identity", "spool", "anchors", "remote_id", "backend", "quota_mb", "prekeys", "other"]
)


@settings(max_examples=150, deadline=None)
@given(document=st.dictionaries(names, values, max_size=10))
def test_any_document_is_settings_or_a_settings_error(document):
    with contextlib.suppress(SettingsError):
        parse(document, Path("/etc/pad.toml"))


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("", ""),
        ("baud_rate = 3000000", ""),
        ('flow_control = "rtscts"', ""),
        ('flow_control = "xonxoff"', r"anchors\[0\]\.flow_control is 'xonxoff'"),
        ("baud_rate = 0", r"anchors\[0\]\.baud_rate is 0"),
        ("baud = 9600", r"anchors\[0\]\.baud is unknown"),
    ],
)
def test_ports_of_nodes(file, line, wrong):
    file.write_text(GOOD.replace("[[anchors]]\n", f"[[anchors]]\n{line}\n", 1))
    if wrong:
        with pytest.raises(SettingsError, match=wrong):
            load(file)
    else:
        anchor = load(file).anchors[0]
        assert anchor.baud_rate == (3_000_000 if "baud" in line else 115_200)
        assert anchor.flow_control == ("rtscts" if "flow" in line else "none")


@pytest.mark.parametrize(
    ("port", "known"), [("rfc2217://10.0.0.7:5000", True), ("spy://x", False), ("socket://x", False)]
)
def test_ports_over_the_network(file, port, known):
    file.write_text(GOOD.replace(f'port = "{load(file).anchors[0].port}"', f'port = "{port}"'))
    if known:
        assert load(file).anchors[0].port == port
    else:
        with pytest.raises(SettingsError, match=r"anchors\[0\]\.port is"):
            load(file)


# --- the commands -------------------------------------------------------------------------------------------------


def test_pad_run_says_what_is_wrong_in_one_line(file):
    result = CliRunner().invoke(pad, ["run", "--config", str(file)])
    assert result.exit_code == 1
    assert "connection file: cannot read" in result.output


def test_pad_status_before_the_first_run_and_after(file):
    result = CliRunner().invoke(pad, ["status", "--config", str(file)])
    assert result.exit_code == 1
    assert "its agent has not run yet" in result.output
    (file.parent / "spool").mkdir()
    status = {
        "pad_id": "pad-1",
        "t_ms": 1_000,
        "session": "",
        "sessions_run": 3,
        "requests_waiting": 0,
        "sessions_to_end": 0,
        "prekeys": 20,
        "accepts_sessions": False,
        "spool_reason": "the disk is full",
        "cannot_prove": ["the disk is full"],
        "spool": {"records": 1, "bytes": 2, "dropped": 0},
        "receiver": {"frames": 4, "bad": 1},
        "anchors": [{"anchor_id": "A1", "state": "up"}],
    }
    (file.parent / "spool" / "status.json").write_text(json.dumps(status))
    result = CliRunner().invoke(pad, ["status", "--config", str(file)])
    assert result.exit_code == 1
    assert "not running" in result.output
    assert "the disk is full" in result.output
    document = json.loads(CliRunner().invoke(pad, ["status", "--config", str(file), "--json"]).output)
    assert document["alive"] is False
    reached = {"assurance": 2, "missing": ["assurance 3: anchor A1 cannot do UL-TDoA"], "unknown": ["A2"]}
    (file.parent / "spool" / "status.json").write_text(json.dumps({**status, "reach": reached}))
    said = CliRunner().invoke(pad, ["status", "--config", str(file)]).output
    assert "2 at most" in said
    assert "anchor A1 cannot do UL-TDoA" in said
    assert "not known of A2" in said
    status |= {"t_ms": time.time_ns() // 1_000_000, "process": os.getpid()}
    lock = ProcessLock(file.parent / "spool" / LOCK_NAME)
    (file.parent / "spool" / "status.json").write_text(json.dumps(status))
    result = CliRunner().invoke(pad, ["status", "--config", str(file)])
    assert result.exit_code == 3
    assert "Pad pad-1: cannot prove" in result.output
    assert "working" not in result.output
    able = status | {"accepts_sessions": True, "cannot_prove": []}
    (file.parent / "spool" / "status.json").write_text(json.dumps(able))
    result = CliRunner().invoke(pad, ["status", "--config", str(file)])
    assert result.exit_code == 0
    assert "Pad pad-1: can prove" in result.output
    del able["accepts_sessions"]  # a file of another version: what it does not say is not believed
    (file.parent / "spool" / "status.json").write_text(json.dumps(able))
    assert CliRunner().invoke(pad, ["status", "--config", str(file)]).exit_code == 3
    lock.release()
    (file.parent / "spool" / "status.json").write_text("[]")
    assert "no status file" in CliRunner().invoke(pad, ["status", "--config", str(file)]).output


def test_uav_prove_says_what_is_wrong_in_one_line(tmp_path):
    arguments = ["prove", "--connection", str(tmp_path), "--port", "/dev/null", "--position", "x", "--pad", "pad-1"]
    result = CliRunner().invoke(uav, arguments)
    assert result.exit_code == 1
    assert "connection file: cannot read" in result.output


@pytest.mark.parametrize("port", ["socket://127.0.0.1", "loop://", ""])
def test_a_drones_port_that_can_never_be_one_is_refused_at_once(tmp_path, port):
    arguments = ["prove", "--connection", str(tmp_path), "--port", port, "--position", "x", "--pad", "pad-1"]
    result = CliRunner().invoke(uav, arguments)
    assert result.exit_code == 2
    assert "socket://" in result.output


def test_a_receiver_listens_on_this_machine_unless_told_otherwise(file):
    file.write_text(GOOD.replace('listen = "[::]:5480"', 'listen = ":5480"'))
    assert load(file).remote_id.listen == ("127.0.0.1", 5480)


@pytest.mark.parametrize(
    ("remote_id", "said", "trusted"),
    [
        ('listen = ":5480"', "UDP 127.0.0.1:5480", True),
        ('listen = "0.0.0.0:5480"', "every machine that reaches this address", False),
        ('listen = "[::]:5480"', "every machine that reaches this address", False),
        ('serial = ["/dev/ttyUSB9"]', "transmitters near the pad", True),
        ('bluetooth = "hci0"', "transmitters near the pad", True),
        ('replay = "heard.pcap"', "a recording", False),
        ('[remote_id.mqtt]\nhost = "broker.example"\ntopics = ["x"]', "without tls_ca", False),
        ('[remote_id.mqtt]\nhost = "b.example"\ntopics = ["x"]\ntls_ca = "ca.pem"', "may publish", True),
        ('[remote_id.mqtt]\nhost = "127.0.0.1"\ntopics = ["x"]', "may publish", True),
    ],
)
def test_a_check_says_which_sources_cannot_be_trusted(file, remote_id, said, trusted):
    file.write_text(GOOD.replace('listen = "[::]:5480"', remote_id))
    result = CliRunner().invoke(pad, ["run", "--config", str(file), "--check"])
    assert result.exit_code == 0, result.output
    assert said in result.output
    assert ("NOT TRUSTWORTHY" in result.output) != trusted


def test_a_check_of_bad_settings_fails(file):
    file.write_text("pad_id = ")
    assert CliRunner().invoke(pad, ["run", "--config", str(file), "--check"]).exit_code == 1
