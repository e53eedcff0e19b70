from __future__ import annotations

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs import encoding
from wonderland.proofs.errors import ProofError, RecordError
from wonderland.proofs.records import keys
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Claim, Evidence, RangeTable
from wonderland.proofs.records.transactions import TRANSACTIONS, GrantAuthorisation, RequestProof

CLAIM = {"lat_e7": 1, "lon_e7": 2, "height_mm": 3, "accuracy_mm": 4, "height_accuracy_mm": 5, "t_ms": 6}


def test_a_record_goes_to_json_and_back():
    claim = Claim.parse(CLAIM)
    assert claim.to_json() == CLAIM
    assert Claim.decode(claim.encode()) == claim


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"lat_e7": 900_000_001}, "claim.lat_e7"),
        ({"lat_e7": True}, "claim.lat_e7"),
        ({"lat_e7": "1"}, "claim.lat_e7"),
        ({"speed": 1}, "claim.speed"),
        ({"accuracy_mm": 0}, "claim.accuracy_mm"),
    ],
)
def test_a_bad_field_is_named(change, path):
    key = "BA" + "A" * 85
    value = {"pad_id": "p", "action": "land", "prekey_id": "k", "uav_key": key, "claim": {**CLAIM, **change}}
    with pytest.raises(RecordError) as caught:
        RequestProof.parse(value)
    assert caught.value.path == path


def test_a_missing_field_is_named():
    with pytest.raises(RecordError, match=r"^pad_id: missing|^action: missing"):
        RequestProof.parse({"claim": CLAIM})


def test_checks_that_concern_two_fields():
    with pytest.raises(RecordError, match="must be below verify_ppm"):
        Policy.parse({"verify_ppm": 5, "refute_ppm": 5})
    with pytest.raises(RecordError, match="2 values for 1 rounds"):
        RangeTable.parse({"t_ms": [1], "anchors": [{"anchor_id": "A", "range_mm": [1, 2]}]})
    radio = {"measured_by": "pad", "sts": "provisioned", "attempted_rounds": 1}
    ranges = {"t_ms": [1, 2], "anchors": [{"anchor_id": "A", "range_mm": [1, 2]}]}
    evidence = {"ranges": ranges, "claims": [], "broadcast": [], "matched": "both", "radio": radio, "steps": []}
    with pytest.raises(RecordError, match=r"^radio.attempted_rounds: 1, but the table has 2 rounds$"):
        Evidence.parse(evidence)
    assert Evidence.parse({**evidence, "radio": {**radio, "attempted_rounds": 2}}).radio.attempted_rounds == 2
    with pytest.raises(RecordError, match="valid_until_ms: must be after"):
        GrantAuthorisation.parse(
            {
                "authorisation_id": "a",
                "uav_id": "u",
                "pad_id": "*",
                "actions": ["land"],
                "valid_from_ms": 5,
                "valid_until_ms": 5,
            }
        )


@pytest.mark.parametrize("transaction", TRANSACTIONS.values(), ids=lambda t: t.name)
def test_each_argument_has_a_valid_json_schema(transaction):
    schema = transaction.argument.json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["additionalProperties"] is False
    assert transaction.argument.__doc__


JSON = st.recursive(
    st.booleans() | st.integers(-(2**53) + 1, 2**53 - 1) | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["pad_id", "claim", "action", "evidence", "x"]), inner, max_size=4)
    ),
    max_leaves=10,
)


@given(st.sampled_from(list(TRANSACTIONS.values())), JSON)
@settings(deadline=None, max_examples=300)
def test_any_value_gives_a_record_or_a_typed_error_and_the_schema_agrees(transaction, value):
    try:
        record = transaction.argument.parse(value)
    except ProofError:
        return
    jsonschema.validate(record.to_json(), transaction.argument.json_schema())
    encoding.encode(record.to_json())


@given(
    st.sampled_from(["pad", "verdict"]),
    st.lists(
        st.text(st.characters(exclude_characters="\x00\U0010ffff", exclude_categories=["Cs"]), min_size=1),
        min_size=1,
        max_size=3,
    ),
)
def test_keys_split_into_what_they_were_made_of(kind, attributes):
    key = keys.composite(kind, *attributes)
    assert keys.split(key) == (kind, tuple(attributes))
    start, end = keys.prefix_range(kind, *attributes[:-1])
    assert start <= key < end
