"""The vectors that others write their verifiers against."""

import json
from pathlib import Path

import pytest
from kit.evidence import patched

from wonderland_chaincode.contract import CONTRACT
from wonderland_evidence.trust import Pins
from wonderland_evidence.verify import verify

VECTORS = Path(__file__).parents[1] / "vectors" / "evidence"
GOOD = (VECTORS / "good.json").read_bytes()
PINS = Pins.decode((VECTORS / "trust.json").read_bytes())
CHANGES = json.loads((VECTORS / "changes.json").read_text())
FIRST_VERSION = "1.0"


def test_the_good_one_holds():
    report = verify(GOOD, PINS)
    assert report.failed is None, report.failed
    assert report.is_whole == (CONTRACT.version == FIRST_VERSION)


@pytest.mark.parametrize("change", CHANGES, ids=lambda each: each["name"].replace(" ", "-"))
def test_each_change_fails_its_step(change):
    assert verify(patched(GOOD, change["patch"]), PINS).failed.number == change["fails"]
