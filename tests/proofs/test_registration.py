"""Openings of operators' numbers: one spelling, one encoding, and nothing that another one could open."""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wonderland.proofs.errors import RecordError
from wonderland.proofs.registration import TYPE, Opening

VECTORS = Path(__file__).parents[2] / "frontend" / "src" / "shared" / "signing" / "registration-vectors.json"
NUMBER = "FIN87astrdge12k8"


def test_the_browsers_vectors_are_ours():
    for each in json.loads(VECTORS.read_text()):
        opening = Opening.of(each["uav_id"], each["registration"], bytes.fromhex(each["salt"]))
        assert opening.commitment == each["sha256"]
        assert opening.commitment == hashlib.sha256(opening.encode()).hexdigest(), "as sha256sum says of the file"


@pytest.mark.parametrize("typed", [NUMBER, "fin87ASTRDGE12K8", f" {NUMBER}-xyz ", f"{NUMBER}xyz", f"{NUMBER}-"])
def test_a_number_has_one_spelling_and_no_secret(typed):
    assert Opening.of("uav-1", typed, secrets.token_bytes(32)).registration == NUMBER


@pytest.mark.parametrize(
    "change",
    [
        {"registration": NUMBER.lower()},
        {"registration": f"{NUMBER}-xyz"},
        {"registration": ""},
        {"salt": "00" * 32},
        {"salt": "0123456789abcdef" * 4},
        {"salt": "0a" * 31},
        {"salt": ("0123456789abcdef" * 4).upper()},
        {"type": "another"},
        {"more": 1},
    ],
)
def test_what_is_no_opening_is_refused(change):
    salt = hashlib.sha256(b"drawn").hexdigest()
    right = {"type": TYPE, "uav_id": "uav-1", "registration": NUMBER, "salt": salt}
    assert Opening.parse(right).commitment
    with pytest.raises(RecordError):
        Opening.parse(right | change)


text = st.text("ABCabc019-._:", min_size=1, max_size=6)


@given(st.tuples(text, text), st.tuples(text, text))
def test_no_two_pairs_have_one_encoding(one, other):
    salt = hashlib.sha256(b"drawn").digest()

    def encoded(uav_id, registration):
        try:
            return Opening.of(uav_id, registration, salt)
        except RecordError:
            return None

    a, b = encoded(*one), encoded(*other)
    if a is not None and b is not None:
        assert (a.encode() == b.encode()) == (a == b)


def test_a_repr_shows_neither_number_nor_salt():
    opening = Opening.of("uav-1", NUMBER, secrets.token_bytes(32))
    assert NUMBER not in repr(opening)
    assert opening.salt not in repr(opening)
