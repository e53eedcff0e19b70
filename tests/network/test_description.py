"""network.yaml: one definition, clear refusals, and a JSON Schema that says the same."""

import contextlib
import json
from pathlib import Path

import jsonschema
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_network.bringing_up import new_network
from wonderland_fabric_network.description import (
    NetworkDescription,
    Organisation,
    json_schema,
    standard_endorsement,
)
from wonderland_fabric_network.errors import DescriptionError
from wonderland_fabric_network.expansion import add_organisation
from wonderland_fabric_network.layout import NetworkDirectory

SCHEMA_FILE = Path(__file__).parents[2] / "docs" / "reference" / "network-schema.json"


def test_an_empty_file_is_the_default_network():
    assert NetworkDescription.from_yaml(b"") == NetworkDescription()


def test_what_is_written_reads_back_the_same(tmp_path):
    described = NetworkDescription().with_ordering("bft", 7)
    described.save(tmp_path / "network.yaml")
    assert NetworkDescription.load(tmp_path / "network.yaml") == described


def test_bft_gets_the_four_orderers_that_it_needs():
    assert NetworkDescription().with_ordering("bft").ordering.count == 4


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("organisations: [{msp_id: A, kind: authority}, {msp_id: a, kind: pads}]", "its own name"),
        ("ordering: {organisations: [{msp_id: PadMSP}]}", "'PadMSP' is also organisations"),
        ("organisations: [{msp_id: PadMSP, kind: pads}]", "exactly one must have kind authority"),
        ("organisations: [{msp_id: A B, kind: authority}]", "organisations[0].msp_id: 'A B' does not match"),
        ("organisations: [{msp_id: A, kind: airline}]", "organisations[0].kind: 'airline' is none of"),
        (
            "contract: {endorsement: \"AND('AuthorityMSP.peer', 'NobodyMSP.peer')\"}",
            "names NobodyMSP, which is none of",
        ),
        ("contract: {endorsement: \"AND('AuthorityMSP.peer'\"}", "it ends where"),
        ("ordering: {consensus: paxos}", "ordering.consensus: 'paxos' is none of raft, bft"),
        ("ordering: {consensus: bft}", "bft needs at least 4"),
        ("ordering: {batch_timeout_ms: 0}", "ordering.batch_timeout_ms: 0 is outside"),
        ("chanel: wonderland", "chanel: unknown field"),
        ("channel: Wonderland", "channel: 'Wonderland' does not match"),
        ("channel: a\nchannel: b", "the field 'channel' stands twice"),
        ("host: &x a\nchannel: *x", "aliases are not allowed"),
        ("[1", "no YAML"),
        ("- 1", "expected an object"),
        ("host: 2026-01-01", "host: expected a string"),
        ("\x00", "no YAML"),
        ("!!python/object/apply:os.system [ls]", "no YAML"),
        ("certificates: {valid_days: 9999}", "certificates.valid_days: 9999 is outside"),
    ],
)
def test_what_is_wrong_is_named(text, says):
    with pytest.raises(DescriptionError) as raised:
        NetworkDescription.from_yaml(text.encode(), "my.yaml")
    assert says in str(raised.value)
    assert str(raised.value).startswith("my.yaml: ")


def test_a_missing_file_and_a_huge_one_are_named(tmp_path):
    with pytest.raises(DescriptionError, match="cannot read"):
        NetworkDescription.load(tmp_path / "none.yaml")
    (tmp_path / "huge.yaml").write_bytes(b"#" * (2 << 20))
    with pytest.raises(DescriptionError, match="larger than"):
        NetworkDescription.load(tmp_path / "huge.yaml")


def test_an_unknown_organisation_is_named(description):
    with pytest.raises(DescriptionError, match="SkyMSP is no organisation of this network; there are AuthorityMSP"):
        description.organisation("SkyMSP")


PAD2 = Organisation(msp_id="Pad2MSP", kind="pads")


def test_the_standard_policy_is_the_authority_and_one_operator_of_pads(description):
    assert standard_endorsement(description.organisations) == description.contract.endorsement
    both = "AND('AuthorityMSP.peer', OR('PadMSP.peer', 'Pad2MSP.peer'))"
    assert standard_endorsement((*description.organisations, PAD2)) == both
    assert standard_endorsement(description.organisations[:1]) == "AND('AuthorityMSP.peer')"
    description.with_organisation(PAD2).with_endorsement(both).require_pads_endorse()


def test_operators_of_pads_who_cannot_sign_are_refused_before_anything_is_written(tmp_path, description):
    both = r"Pad2MSP without a signature.*Next: write AND\('AuthorityMSP.peer', OR\('PadMSP.peer', 'Pad2MSP.peer'\)\)"
    with pytest.raises(DescriptionError, match=both):
        new_network(NetworkDirectory(tmp_path / "net"), description.with_organisation(PAD2))
    assert not (tmp_path / "net" / "network.yaml").exists()


async def test_a_policy_of_ones_own_is_extended_by_hand(tmp_path, description):
    own = description.with_endorsement("AND('AuthorityMSP.peer', 'PadMSP.peer', 'FleetMSP.peer')")
    network = new_network(NetworkDirectory(tmp_path / "net"), own)
    with pytest.raises(DescriptionError, match=r"one of your own\. Next: say with --endorsement what it becomes"):
        await add_organisation(network, None, PAD2, lambda *_: None)
    with pytest.raises(DescriptionError, match="Pad2MSP without a signature"):
        await add_organisation(network, None, PAD2, lambda *_: None, endorsement="AND('AuthorityMSP.peer')")
    assert NetworkDescription.load(network.directory.description_file) == own


def test_the_schema_file_is_the_definition():
    assert json.loads(SCHEMA_FILE.read_text()) == json_schema()


def test_the_default_network_meets_the_schema(description):
    jsonschema.Draft202012Validator.check_schema(json_schema())
    jsonschema.validate(description.to_json(), json_schema())


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=8) | st.floats(allow_nan=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
_fields = st.sampled_from(["channel", "organisations", "ordering", "contract", "certificates", "host", "first_port"])


@settings(deadline=None, max_examples=80)
@given(st.dictionaries(_fields, _values, max_size=3))
def test_whatever_is_accepted_meets_the_schema_and_all_else_is_a_typed_error(document):
    try:
        NetworkDescription.from_yaml(yaml.safe_dump(document).encode())
    except DescriptionError:
        return
    jsonschema.validate(document, json_schema())


@settings(deadline=None, max_examples=80)
@given(st.binary(max_size=200))
def test_any_bytes_are_a_description_or_a_typed_error(data):
    with contextlib.suppress(DescriptionError):
        NetworkDescription.from_yaml(data)
