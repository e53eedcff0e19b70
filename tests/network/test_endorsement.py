"""Endorsement policies as text."""

import contextlib

import pytest
from fabric_protos.common import policies_pb2
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_network.endorsement import endorsement_text, organisations_of, parse_endorsement
from wonderland_fabric_network.errors import DescriptionError


def test_and_of_two_is_two_out_of_two():
    policy = parse_endorsement("AND('AuthorityMSP.peer', 'PadMSP.peer')")
    assert policy.organisations == ("AuthorityMSP", "PadMSP")
    assert policy.rule.n_out_of.n == 2
    assert [each.signed_by for each in policy.rule.n_out_of.rules] == [0, 1]


def test_nested_rules_share_principals():
    policy = parse_endorsement('OutOf(2, "A.peer", or(\'B.peer\',\'A.peer\'), AND("C.admin" , "B.peer"))')
    assert [(each.msp_id, each.role) for each in policy.principals] == [("A", "peer"), ("B", "peer"), ("C", "admin")]
    assert policy.rule.n_out_of.n == 2
    assert [each.signed_by for each in policy.rule.n_out_of.rules[1].n_out_of.rules] == [1, 0]


def test_an_msp_id_may_have_dots():
    assert parse_endorsement("'pads.example.org.peer'").organisations == ("pads.example.org",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "it ends where a rule should stand"),
        ("AND()", "is none of AND, OR"),
        ("AND('A.peer'", "it ends where"),
        ("AND('A.peer') 'B.peer'", "stands after its end"),
        ("'A.boss'", "is no principal"),
        ("'peer'", "is no principal"),
        ("'.peer'", "is no principal"),
        ("XOR('A.peer')", "'XOR' is none of"),
        ("OutOf(3, 'A.peer', 'B.peer')", "OutOf(3, …) over 2 rules"),
        ("OutOf(0, 'A.peer')", "OutOf(0, …)"),
        ("OutOf('A.peer')", "takes a number first"),
        ("AND('A.peer' 'B.peer')", "',' or ')' should stand"),
        ("AND('A.peer', ;)", "cannot read ' ;)'"),
        ("AND(" * 30 + "'A.peer'" + ")" * 30, "nested deeper"),
        ("OR(" + ",".join(f"'M{i}.peer'" for i in range(300)) + ")", "more than 200 principals"),
    ],
)
def test_what_is_wrong_is_quoted(text, says):
    with pytest.raises(DescriptionError) as raised:
        parse_endorsement(text)
    assert says in str(raised.value)


_principals = st.builds("'{}.{}'".format, st.sampled_from("ABC"), st.sampled_from(["peer", "member", "admin"]))
_rules = st.recursive(
    _principals,
    lambda inner: st.builds(
        lambda operator, rules: f"{operator}({', '.join(rules)})",
        st.sampled_from(["AND", "OR", "OutOf(1"]).map(lambda each: each),
        st.lists(inner, min_size=1, max_size=3),
    ).map(lambda text: text.replace("OutOf(1(", "OutOf(1, ")),
    max_leaves=8,
)


@settings(deadline=None, max_examples=80)
@given(_rules)
def test_every_policy_names_only_principals_that_it_has(text):
    policy = parse_endorsement(text)
    again = policies_pb2.SignaturePolicyEnvelope.FromString(policy.envelope().SerializeToString())
    count = len(again.identities)

    def check(rule):
        if rule.WhichOneof("Type") == "signed_by":
            assert 0 <= rule.signed_by < count
            return
        assert 1 <= rule.n_out_of.n <= len(rule.n_out_of.rules)
        for each in rule.n_out_of.rules:
            check(each)

    check(again.rule)
    assert len(policy.principals) == count


@settings(deadline=None, max_examples=80)
@given(_rules)
def test_what_a_channel_agreed_on_is_said_as_text_and_means_the_same(text):
    policy = parse_endorsement(text)
    parameter = policy.validation_parameter()
    assert parse_endorsement(endorsement_text(parameter)).validation_parameter() == parameter
    assert organisations_of(parameter) == set(policy.organisations)


@pytest.mark.parametrize("data", [b"\xff", b"\x0a\x02\xff\xff"])
def test_a_policy_that_is_none_is_said_to_be(data):
    with pytest.raises(DescriptionError):
        endorsement_text(data)


@settings(deadline=None, max_examples=80)
@given(st.text(alphabet="ANDORutf('.peer',1 2)", max_size=40))
def test_any_text_is_a_policy_or_a_typed_error(text):
    with contextlib.suppress(DescriptionError):
        parse_endorsement(text)
