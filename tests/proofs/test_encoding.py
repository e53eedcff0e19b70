from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
VALUES = st.recursive(
    st.booleans() | st.integers(-encoding.MAX_INTEGER, encoding.MAX_INTEGER) | TEXT,
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(TEXT, inner, max_size=5),
    max_leaves=20,
)


@given(VALUES)
@settings(deadline=None)
def test_what_is_encoded_decodes_to_itself_and_encodes_the_same(value):
    data = encoding.encode(value)
    assert encoding.decode(data) == value
    assert encoding.encode(encoding.decode(data)) == data
    assert json.loads(data) == value


@given(st.dictionaries(TEXT, st.integers(-5, 5), max_size=8))
@settings(deadline=None)
def test_key_order_does_not_matter_and_follows_utf16(value):
    keys = list(json.loads(encoding.encode(value)))
    assert keys == sorted(value, key=lambda key: key.encode("utf-16-be"))
    assert encoding.encode(dict(reversed(value.items()))) == encoding.encode(value)


def test_rfc_8785_sorting_example():
    value = {"\u20ac": 1, "\r": 2, "\ufb33": 3, "1": 4, "\U0001f600": 5, "\u0080": 6, "\u00f6": 7}
    assert [*json.loads(encoding.encode(value)).values()] == [2, 4, 6, 7, 1, 5, 3]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b'{"a":1.0}', "not an integer"),
        (b'{"a":1e3}', "not an integer"),
        (b'{"a":NaN}', "not an integer"),
        (b'{"a":null}', "null"),
        (b'{"a":1,"a":2}', "twice"),
        (b'{"a":9007199254740992}', "beyond"),
        (b'{"a":' + b"9" * 5000 + b"}", "beyond"),
        (b'{"a":-0}', "-0"),
        (b'"\\ud800"', "surrogate"),
        (b"\xff", "UTF-8"),
        (b"{", "not JSON"),
        (b"", "not JSON"),
        (b"[" * 100_000, "nested"),
        (b'{"a":' * 40 + b"1" + b"}" * 40, "nested"),
    ],
)
def test_what_the_model_does_not_have_is_refused(text, reason):
    with pytest.raises(EncodingError, match=reason):
        encoding.decode(text)


@given(st.binary(max_size=200))
@settings(deadline=None, max_examples=300)
def test_any_bytes_give_a_value_or_an_encoding_error(data):
    try:
        encoding.decode(data)
    except EncodingError:
        return


def test_brackets_in_strings_are_no_nesting():
    assert encoding.decode(encoding.encode({"a": "[" * 1000 + '"\\'})) == {"a": "[" * 1000 + '"\\'}


def test_size_limit_names_both_numbers():
    with pytest.raises(EncodingError, match="11 bytes are more than the 10"):
        encoding.decode(b'"123456789"', max_bytes=10)


@pytest.mark.parametrize("value", [1.5, None, {1: 2}, {"a": object()}, 2**53])
def test_encode_refuses_what_it_cannot_say(value):
    with pytest.raises(EncodingError):
        encoding.encode(value)


@given(st.binary(max_size=80))
@settings(deadline=None)
def test_base64url_round_trip(data):
    assert encoding.from_base64url(encoding.to_base64url(data)) == data


@pytest.mark.parametrize("text", ["A", "AA=", "A+/=", "AB", "é"])
def test_base64url_refuses_other_spellings(text):
    with pytest.raises(EncodingError):
        encoding.from_base64url(text)
