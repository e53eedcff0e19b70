"""What is no evidence: a typed error that names the step, and an exit code that scripts can tell apart."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from fabric_protos.common import common_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from kit.evidence import lines, run, with_block

from wonderland.proofs import encoding
from wonderland_evidence.bundle import MAX_BYTES, Bundle
from wonderland_evidence.case import Case
from wonderland_evidence.errors import UnreadableError
from wonderland_evidence.trust import Pins

pytestmark = pytest.mark.timeout(300)
YEAR_1970_S = 0
YEAR_2100_S = 4_102_444_800


@pytest.fixture
def told(small, tmp_path):
    """What the command says of a file's bytes: exit code and the first step that does not hold."""

    def of(data, trust=None):
        files = tmp_path / "evidence.json", tmp_path / "trust.json"
        files[0].write_bytes(data)
        files[1].write_bytes(small.trust if trust is None else trust)
        result = run("verify", files[0], "--trust", files[1], "--json")
        bad = [each for each in lines(result) if each["status"] == "fails"]
        return result.exit_code, bad[0] if bad else None

    return of


def test_what_is_no_bundle_is_refused_before_any_step(small, told):
    data = small.data
    value = json.loads(data)
    for made, code in (
        (data[: len(data) // 2], "cut"),
        (data[:-1], "cut"),
        (data + data, "concatenated"),
        (b"", "cut"),
        (b"\x00" * 1000, "cut"),
        (data + b"\n", "not_canonical"),
        (json.dumps(value).encode(), "not_canonical"),
        (json.dumps(value, indent=1).encode(), "not_canonical"),
        (data.replace(b'"chaincode":"pol"', b'"chaincode":"pol","chaincode":"pol"'), "not_json"),
        (data.replace(b"wonderland-evidence/1", b"wonderland-evidence/2"), "unknown_version"),
        (data.replace(b'"channel":', b'"canal":', 1), "not_canonical"),
        (b'{"format":' + b"[" * 100_000 + b"]" * 100_000 + b"}", "not_json"),
        (small.trust, "not_canonical"),
        (b'{"format":"wonderland-evidence/1"}', "wrong_field"),
        (data.replace(b'"session_id":"', b'"session_id":["'), "not_json"),
    ):
        exit_code, step = told(made)
        assert (exit_code, step["step"], step["name"], step["code"]) == (3, 0, "file", code), made[:80]


def test_a_gigabyte_is_not_read(tmp_path, small):
    """A file with a hole: as long as it says, and nothing on the disk."""
    huge = tmp_path / "huge.json"
    with huge.open("wb") as file:
        file.truncate(1 << 30)
    trust = tmp_path / "trust.json"
    trust.write_bytes(small.trust)
    result = run("verify", huge, "--trust", trust, "--json")
    assert result.exit_code == 3
    assert lines(result)[0]["code"] == "too_large"
    assert f"{MAX_BYTES >> 20} MiB" in lines(result)[0]["text"]


def test_a_trust_file_that_is_none(small, told):
    document = json.loads(small.trust)
    document["organisations"]["PadMSP"]["roots"][0]["sha256"] = "0" * 64
    for made in (b"{}", small.data, small.trust[:-20], json.dumps(document).encode()):
        exit_code, step = told(small.data, made)
        assert (exit_code, step["step"]) == (3, 0)


def test_foreign_roots_fail_the_first_step(small, told):
    document = json.loads(small.trust)
    other = document["organisations"]["FleetMSP"]["roots"]
    document["organisations"]["PadMSP"]["roots"] = other
    exit_code, step = told(small.data, json.dumps(document).encode())
    assert (exit_code, step["step"], step["name"]) == (1, 1, "trust")
    assert "root certificate of PadMSP is not pinned" in step["text"]
    document = json.loads(small.trust)
    document["genesis_hash"] = "ab" * 32
    assert told(small.data, json.dumps(document).encode())[1]["step"] == 1


@pytest.mark.parametrize("seconds", [YEAR_1970_S, YEAR_2100_S])
def test_clocks_of_1970_and_2100_fail_the_step_of_certificates(small, told, seconds):
    """By the time that a question to the peers bears, no certificate was valid."""
    answer = small.bundle.validity[0]
    header = common_pb2.ChannelHeader.FromString(answer.channel_header)
    header.timestamp.seconds = seconds
    changed = replace(answer, channel_header=header.SerializeToString())
    bundle = replace(small.bundle, validity=(changed, *small.bundle.validity[1:]))
    exit_code, step = told(bundle.encode())
    assert (exit_code, step["step"], step["name"]) == (1, 11, "validity")


@pytest.mark.parametrize("seconds", [YEAR_1970_S, YEAR_2100_S])
def test_a_transaction_of_such_a_time_has_no_valid_sender(small, seconds):
    """Its sender's certificate was not valid then, whatever else would hold."""
    from wonderland_fabric_gateway.errors import VerificationError
    from wonderland_fabric_gateway.verification.channel_trust import APPLICATION

    case = Case(small.bundle)
    place = case.of_session("SubmitProof")
    creator = case.transaction(place, "").parsed.creator.creator
    with pytest.raises(VerificationError, match="not valid yet" if seconds == 0 else "expired"):
        case.trust_before(place.block).member(creator, seconds * 1000, APPLICATION)


def test_blocks_that_hold_anything_are_no_way_around_a_step(small, told):
    """Protocol buffers of every kind where others belong, and bytes that are none."""
    block = Case(small.bundle).of_session("SubmitProof").block
    data = next(each for each in small.bundle.blocks if each.number == block).data
    for junk in (b"\x0a" * 50, b"\x0a\x80\x80\x80\x80\x08", data[0][:-1], b"\x00"):
        exit_code, step = told(with_block(small.bundle, block, data=(junk,)).encode())
        assert exit_code == 1
        assert step["step"] in range(1, 14)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_refused(data):
    for read in (Bundle.decode, Pins.decode):
        with pytest.raises(UnreadableError):
            read(data)


json_values = st.recursive(
    st.booleans() | st.integers(-5, 2**53 - 1) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


def paths(value, path=()):
    """Every place in a JSON value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in inside:
        yield (*path, key)
        yield from paths(each, (*path, key))


@settings(max_examples=150, deadline=None)
@given(number=st.integers(0, 10**6), value=json_values)
def test_any_value_in_any_field_is_refused_or_fails_a_step(small, number, value):
    document = json.loads(small.data)
    places = list(paths(document))
    *path, key = places[number % len(places)]
    container = document
    for each in path:
        container = container[each]
    if value == container[key]:
        return
    container[key] = value
    try:
        report = small.report(encoding.encode(document))
    except UnreadableError:
        return
    assert report.failed is not None
