"""RFC 3161: a session's last block, stamped by OpenSSL's own service, and everything that is no such stamp."""

from __future__ import annotations

import hashlib
import json
import os
import random
import warnings
from dataclasses import replace

import pytest
from asn1crypto import tsp
from kit.bombs import bomb, peak_kb
from kit.evidence import Exhibit, run
from kit.timestamping import OPENSSL, Service, openssl

from wonderland_evidence.bundle import Bundle, TimeStamp
from wonderland_evidence.errors import StepError
from wonderland_evidence.stamping import _token
from wonderland_evidence.timestamps import read_token
from wonderland_evidence.verify import verify
from wonderland_fabric_gateway.certificates import certificate_of

pytestmark = [pytest.mark.timeout(120), pytest.mark.skipif(OPENSSL is None, reason="openssl is needed")]
EVERY = os.environ.get("EVIDENCE_BYTES", "") == "all"
RSA = ("-newkey", "rsa:2048")


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    return Service(tmp_path_factory.mktemp("tsa"))


@pytest.fixture(scope="module")
def stamped(small, service, tmp_path_factory):
    """The bundle, exported anew with a time-stamp, and a trust file that pins the service."""
    directory = tmp_path_factory.mktemp("stamped")
    files = directory / "evidence.json", directory / "trust.json"
    connection = ("--connection", small.place.connection_file)
    with service.served():
        wanted = ("--session", small.session_id, "--timestamp", service.url)
        told = run("export", *connection, *wanted, "--out", files[0])
    assert told.exit_code == 0, told.output
    told = run("trust", *connection, "--timestamp-root", service.root, "--out", files[1])
    assert told.exit_code == 0, told.output
    return Exhibit("embedded", files[0].read_bytes(), files[1].read_bytes(), small.session_id, small.place)


def step_12(report):
    return report.findings[11]


def test_the_stamp_says_not_later_than(stamped):
    report = stamped.report()
    assert report.failed is None, report.failed
    assert {each.status for each in report.findings} == {"holds"}
    (stamp,) = stamped.bundle.timestamps
    assert step_12(report).text.startswith(f"block {stamp.block} not later than 20")


def test_without_a_pinned_root_it_is_not_checked(stamped, small):
    found = step_12(verify(stamped.data, small.pins))
    assert (found.status, "pins no root" in found.text) == ("not_checked", True)


def test_one_changed_byte_of_a_token_is_found(stamped, service):
    (stamp,) = stamped.bundle.timestamps
    roots = (certificate_of(service.root.read_bytes()),)
    read_token(stamp.token, roots)
    rng = random.Random(3)
    missed = []
    every = range(len(stamp.token))
    for at in every if EVERY else rng.sample(every, 80):
        token = bytearray(stamp.token)
        token[at] ^= rng.randrange(1, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                read_token(bytes(token), roots)
            except StepError:
                continue
        missed.append(at)
    assert not missed


def test_a_stamp_of_another_block_or_service_fails(stamped, tmp_path):
    bundle = stamped.bundle
    (stamp,) = bundle.timestamps
    moved = replace(bundle, timestamps=(TimeStamp(stamp.block - 1, stamp.token),))
    assert stamped.failing(moved)[0] == 12
    gone = replace(bundle, timestamps=(TimeStamp(10**6, stamp.token),))
    assert "not in the file" in stamped.failing(gone)[1]
    other = Service(tmp_path)
    document = json.loads(stamped.trust)
    document["timestamp_roots"] = [{"pem": other.root.read_text()}]
    number, text = replace(stamped, trust=json.dumps(document).encode()).failing(bundle)
    assert (number, "pinned root" in text) == (12, True)


def test_a_service_with_an_rsa_key_serves_too(tmp_path):
    digest = hashlib.sha256(b"x").digest()
    query = tmp_path / "query"
    openssl("ts", "-query", "-digest", digest.hex(), "-sha256", "-cert", "-out", query)
    nonce = tsp.TimeStampReq.load(query.read_bytes())["nonce"].native
    service = Service(tmp_path, key=RSA)
    token = _token(service.reply(query.read_bytes()), digest, nonce)
    root = certificate_of(service.root.read_bytes())
    assert read_token(token, (root,)).imprint == digest
    with pytest.raises(StepError, match="pinned root"):
        read_token(token, ())
    with pytest.raises(StepError, match="cannot be read"):
        read_token(token[:-1], (root,))


def test_a_service_that_answers_nonsense_is_an_error_in_words(small, service, tmp_path):
    wanted = ("--connection", small.place.connection_file, "--session", small.session_id, "--out", tmp_path / "x")
    for answer in (b"", b"\x30\x03\x02\x01\x02", b"x" * (1 << 20)):
        with service.served(answer):
            told = run("export", *wanted, "--timestamp", service.url)
        assert told.exit_code == 1
        assert "time-stamp" in told.output
    with service.served(bomb(600), "gzip, gzip"):
        before_kb = peak_kb()
        told = run("export", *wanted, "--timestamp", service.url)
    assert told.exit_code == 1
    assert peak_kb() - before_kb < 100_000, "it is never unpacked"
    told = run("export", *wanted, "--timestamp", "http://127.0.0.1:1/")
    assert (told.exit_code, "does not answer" in told.output) == (1, True)
    assert not (tmp_path / "x").exists()


def test_stamped_files_are_canonical_too(stamped):
    assert Bundle.decode(stamped.data).encode() == stamped.data


@pytest.mark.browser
def test_the_page_checks_stamps_as_well(stamped, shown_in):
    statuses, line = shown_in(stamped.data, stamped.trust)
    assert statuses == ["holds"] * 12 + ["not_checked"], line
    bundle = stamped.bundle
    (stamp,) = bundle.timestamps
    rng = random.Random(4)
    made = [TimeStamp(stamp.block - 1, stamp.token)]
    for at in rng.sample(range(len(stamp.token)), 40):
        token = bytearray(stamp.token)
        token[at] ^= rng.randrange(1, 256)
        made.append(TimeStamp(stamp.block, bytes(token)))
    for each in made:
        statuses, line = shown_in(replace(bundle, timestamps=(each,)).encode(), stamped.trust)
        assert statuses[11] == "fails", line
