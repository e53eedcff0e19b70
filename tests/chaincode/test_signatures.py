from __future__ import annotations

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_chaincode.contract.signatures import P256_ORDER, is_point, signature_holds

KEY = ec.derive_private_key(77, ec.SECP256R1())
NUMBERS = KEY.public_key().public_numbers()
PUBLIC = b"\x04" + NUMBERS.x.to_bytes(32, "big") + NUMBERS.y.to_bytes(32, "big")
MESSAGE = b"here I am"


def raw(r: int, s: int) -> bytes:
    return r.to_bytes(32, "big") + s.to_bytes(32, "big")


@pytest.fixture(scope="module")
def low_and_high():
    r, s = decode_dss_signature(KEY.sign(MESSAGE, ec.ECDSA(hashes.SHA256())))
    low = min(s, P256_ORDER - s)
    return raw(r, low), raw(r, P256_ORDER - low)


def test_a_signature_holds_for_its_message_key_and_low_form_only(low_and_high):
    low, high = low_and_high
    assert signature_holds(PUBLIC, MESSAGE, low)
    assert not signature_holds(PUBLIC, MESSAGE, high)
    assert not signature_holds(PUBLIC, MESSAGE + b"!", low)
    other = ec.derive_private_key(78, ec.SECP256R1()).public_key().public_numbers()
    assert not signature_holds(b"\x04" + other.x.to_bytes(32, "big") + other.y.to_bytes(32, "big"), MESSAGE, low)


@pytest.mark.parametrize(
    "signature", [b"", bytes(64), bytes(63), raw(1, 0), raw(0, 1), raw(P256_ORDER, 1), b"\xff" * 64]
)
def test_numbers_out_of_range_do_not_hold(signature):
    assert not signature_holds(PUBLIC, MESSAGE, signature)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(data=st.data())
def test_one_flipped_bit_anywhere_does_not_hold(low_and_high, data):
    low, _ = low_and_high
    bit = data.draw(st.integers(0, 511))
    flipped = bytearray(low)
    flipped[bit // 8] ^= 1 << bit % 8
    assert not signature_holds(PUBLIC, MESSAGE, bytes(flipped))


def test_points_of_the_curve():
    assert is_point(PUBLIC)
    x, y = PUBLIC[1:33], PUBLIC[33:]
    compressed = bytes([2 + (y[-1] & 1)]) + x
    for wrong in (b"", b"\x00", compressed, compressed + bytes(32), b"\x04" + y + x, b"\x06" + x + y, PUBLIC + b"\x00"):
        assert not is_point(wrong)
    assert not signature_holds(b"\x04" + bytes(64), MESSAGE, raw(1, 1))
