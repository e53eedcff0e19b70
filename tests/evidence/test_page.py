"""The second verifier, a page without a server, agrees with the first one; in Chromium."""

import json
import random
from dataclasses import replace
from pathlib import Path

import pytest
from kit.evidence import patched

from wonderland_evidence.errors import UnreadableError

ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "tests" / "vectors" / "evidence"
GOOD = (VECTORS / "good.json").read_bytes()
TRUST = (VECTORS / "trust.json").read_bytes()
CHANGES = json.loads((VECTORS / "changes.json").read_text())
ALPHABET = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_"
pytestmark = [pytest.mark.browser, pytest.mark.timeout(300)]


def failing(statuses):
    return statuses.index("fails") + 1 if "fails" in statuses else None


def test_the_good_one_holds_and_the_last_step_is_said_not_to_be_checked(shown_in):
    statuses, line = shown_in(GOOD, TRUST)
    assert statuses == ["holds"] * 11 + ["not_checked"] * 2, line
    assert "All steps hold but 12 and 13, not checked here" in line
    assert "one process holds the keys" in line


def test_each_vector_fails_its_step(shown_in):
    for change in CHANGES:
        statuses, line = shown_in(patched(GOOD, change["patch"]), TRUST)
        assert failing(statuses) == change["fails"], (change["name"], line)


def test_what_is_no_bundle_is_not_read(shown_in):
    for data in (GOOD[:-1], GOOD + GOOD, GOOD + b"\n", json.dumps(json.loads(GOOD)).encode(), b"", TRUST):
        statuses, line = shown_in(data, TRUST)
        assert (statuses, "cannot be read" in line) == ([], True)
    doubled = GOOD.replace(b'"chaincode":"pol"', b'"chaincode":"pol","chaincode":"pol"')
    assert "canonical" in shown_in(doubled, TRUST)[1]
    pinned = json.loads(TRUST)
    pinned["organisations"]["PadMSP"] = pinned["organisations"]["FleetMSP"]
    assert failing(shown_in(GOOD, json.dumps(pinned).encode())[0]) == 1


def test_both_find_a_changed_byte(shown_in, small):
    rng = random.Random(11)
    for at in rng.sample(range(len(GOOD)), 40):
        data = bytearray(GOOD)
        data[at] = rng.choice(ALPHABET.replace(bytes([data[at]]), b"")) if data[at] in ALPHABET else data[at] ^ 1
        try:
            assert replace(small, trust=TRUST).report(bytes(data)).failed is not None
            is_read = True
        except UnreadableError:
            is_read = False
        statuses, line = shown_in(bytes(data), TRUST)
        assert ("fails" in statuses) == is_read, (at, line)
        assert is_read or "cannot be read" in line, (at, line)


def test_the_page_reads_what_either_ledger_gives(shown_in, shown):
    statuses, line = shown_in(shown.data, shown.trust)
    assert statuses == ["holds"] * 11 + ["not_checked"] * 2, line
