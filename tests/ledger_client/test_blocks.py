"""Blocks: what they say, the hashes, and what is refused."""

from __future__ import annotations

import contextlib
import hashlib

import pytest
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature
from fabric_protos.common import common_pb2
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.blocks import BlockHeader, TransactionType, block_signatures, data_hash, parse_block
from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.signing import verify
from wonderland_fabric_gateway.transactions import RangeQuery, Read, ReadsSummary, Version, Write, code_name

MODERATE = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def der_integer(number: int) -> bytes:
    """A DER INTEGER by the library, as a second opinion."""
    return encode_dss_signature(number, 1)[2:-3]


@MODERATE
@given(st.integers(1, 2**64 - 1))
def test_the_header_hash_is_over_der(number):
    header = BlockHeader(number, b"\x11" * 32, b"\x22" * 32)
    body = der_integer(number) + b"\x04\x20" + b"\x11" * 32 + b"\x04\x20" + b"\x22" * 32
    assert header.der == b"\x30" + bytes([len(body)]) + body
    assert header.hash == hashlib.sha256(header.der).digest()


def test_the_first_header():
    header = BlockHeader(0, b"", b"\x22" * 32)
    assert header.der == b"\x30\x27\x02\x01\x00\x04\x00\x04\x20" + b"\x22" * 32


def test_a_transaction(maker, pad, peer):
    message = maker.block([maker.transaction()])
    block = parse_block(message.SerializeToString())
    assert (block.number, block.header.previous_hash) == (5, b"p" * 32)
    assert block == parse_block(message)
    assert block.to_bytes() == message.SerializeToString()
    (transaction,) = block.transactions
    assert transaction.type is TransactionType.ENDORSER
    assert transaction.tx_id == hashlib.sha256(b"n" * 24 + pad.identity.creator).hexdigest()
    assert (transaction.channel, transaction.timestamp_ms, transaction.index) == ("wonderland", 1_700_000_000_123, 0)
    assert (transaction.is_valid, transaction.validation_name) == (True, "VALID")
    assert transaction.creator == pad.identity
    assert transaction.endorsers == (peer.identity,)
    assert (transaction.event.name, transaction.event.payload, transaction.event.chaincode) == (
        "Done",
        b"payload",
        "pol",
    )
    invocation = transaction.invocation
    assert (invocation.chaincode, invocation.chaincode_version, invocation.function) == ("pol", "1.0", "DoIt")
    assert invocation.args == (b"DoIt", b"{}")
    assert (invocation.response.status, invocation.response.payload) == (200, b"answer")
    access = invocation.accesses[1]
    assert access.namespace == "pol"
    assert access.reads == (Read("a", Version(3, 1)), Read("b", None))
    assert access.writes == (Write("c", b"value", is_delete=False), Write("d", b"", is_delete=True))
    assert access.range_queries == (
        RangeQuery("p", "q", exhausted=True, reads=(Read("p1", Version(3, 1)),)),
        RangeQuery("r", "", exhausted=False, reads=None, summary=ReadsSummary(50, 0, ())),
    )
    assert [namespace for namespace, _ in transaction.writes] == ["pol", "pol"]


def test_what_the_parser_gives_is_enough_to_verify_it(maker):
    (transaction,) = parse_block(maker.block([maker.transaction()])).transactions
    envelope = common_pb2.Envelope.FromString(maker.transaction())
    verify(transaction.creator.public_key, envelope.payload, transaction.signature)
    (endorsement,) = transaction.invocation.endorsements
    signed = transaction.invocation.response_payload + endorsement.endorser.creator
    verify(endorsement.endorser.public_key, signed, endorsement.signature)


def test_without_event_or_arguments(maker):
    (transaction,) = parse_block(maker.block([maker.transaction(args=(), event=None)])).transactions
    assert transaction.event is None
    assert transaction.invocation.function == ""


def test_the_signatures_and_what_they_are_over(maker, peer):
    block = parse_block(maker.block([maker.transaction()]))
    first, second = block_signatures(block)
    assert (first.signer, first.consenter_id, first.signature) == (peer.identity, None, b"s")
    assert first.message.startswith(b"last config")
    assert first.message.endswith(block.header.der)
    assert (second.signer, second.consenter_id) == (None, 4)


def test_blocks_follow_each_other(maker):
    first = parse_block(maker.block([maker.transaction()], number=5))
    second = parse_block(maker.block([maker.transaction()], number=6, previous=first.header_hash))
    second.require_follows(first.header)
    with pytest.raises(BlockError, match="missing"):
        parse_block(maker.block([maker.transaction()], number=7)).require_follows(first.header)
    with pytest.raises(BlockError, match="does not continue"):
        parse_block(maker.block([maker.transaction()], number=6)).require_follows(first.header)


def test_a_config_block(maker, ca):
    envelope = maker.config(organisations=("PadMSP", "FleetMSP"), crls=[b"crl"], sections=("Application", "Orderer"))
    block = parse_block(maker.block([envelope], number=0, previous=b"", codes=[]))
    (transaction,) = block.transactions
    assert (transaction.type, transaction.creator, transaction.is_valid) == (TransactionType.CONFIG, None, True)
    assert block.config.sequence == 7
    assert set(block.config.organisations) == {"PadMSP", "FleetMSP"}
    organisation = block.config.organisations["PadMSP"]
    assert organisation.root_certs == (ca.root_pem(),)
    assert organisation.revocation_lists == (b"crl",)
    assert organisation.sections == ("Application", "Orderer")
    assert organisation.node_ous == {"client": "client"}


def test_one_name_with_two_roots_is_refused(maker):
    roots = {"Application": [b"a"], "Orderer": [b"b"]}
    envelope = maker.config(sections=("Application", "Orderer"), roots=roots)
    with pytest.raises(BlockError, match="different certificates"):
        parse_block(maker.block([envelope]))


def test_an_empty_config_is_refused(maker):
    with pytest.raises(BlockError, match="no organisation"):
        parse_block(maker.block([maker.config(organisations=())]))


def test_a_refused_transaction_may_be_malformed_and_a_valid_one_not(maker):
    half = maker.transaction()[:-80]
    wrong = maker.envelope(maker.header(), b"\xff\xff")
    block = parse_block(maker.block([maker.transaction(), half, wrong], codes=[0, 2, 16]))
    assert [each.type for each in block.transactions] == ["endorser", "malformed", "malformed"]
    assert block.transactions[2].tx_id == block.transactions[0].tx_id
    assert block.transactions[2].problem
    assert block.transactions[2].validation_name == "NIL_TXACTION"
    with pytest.raises(BlockError, match="block 5, transaction 1 is marked valid but malformed"):
        parse_block(maker.block([maker.transaction(), half]))


def test_other_types_are_named(maker):
    envelope = maker.envelope(maker.header(kind=common_pb2.MESSAGE), b"whatever")
    (transaction,) = parse_block(maker.block([envelope], codes=[13])).transactions
    assert transaction.type is TransactionType.UNSUPPORTED


def test_a_block_that_no_peer_has_seen_is_not_validated(maker):
    (transaction,) = parse_block(maker.block([maker.transaction()], codes=[])).transactions
    assert transaction.validation_name == "NOT_VALIDATED"
    assert not transaction.is_valid


def test_unknown_codes_have_a_name():
    assert code_name(200) == "CODE_200"


def damaged(change):
    def apply(block):
        change(block)
        return block

    return apply


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda block: block.data.data.append(b"more"), "data_hash"),
        (lambda block: block.data.ClearField("data"), "0 transactions"),
        (lambda block: setattr(block.header, "data_hash", b"short"), "5 bytes"),
        (lambda block: setattr(block.header, "previous_hash", b""), "0 bytes"),
        (lambda block: setattr(block.header, "previous_hash", bytes(1000)), "1000 bytes"),
        (lambda block: block.metadata.metadata.__setitem__(2, b"\0\0"), "2 validation codes"),
    ],
)
def test_contradictions_are_refused(maker, change, words):
    block = maker.block([maker.transaction()])
    change(block)
    with pytest.raises(BlockError, match=words):
        parse_block(block)


def test_a_time_out_of_bounds(maker):
    envelope = maker.transaction(header=maker.header(seconds=1 << 60))
    with pytest.raises(BlockError, match="timestamp"):
        parse_block(maker.block([envelope]))


@MODERATE
@given(st.binary(max_size=400))
def test_garbage_is_a_typed_error(data):
    with pytest.raises(BlockError):
        parse_block(data)


@MODERATE
@given(st.data())
def test_damage_is_a_typed_error_or_a_block(maker, data):
    """Any bytes changed, hashes mended so that the damage reaches the inner parsers."""
    kind = data.draw(st.sampled_from(["transaction", "config"]))
    envelope = bytearray(maker.transaction() if kind == "transaction" else maker.config())
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(envelope) - 1))
        if data.draw(st.booleans()):
            envelope[at] = data.draw(st.integers(0, 255))
        else:
            del envelope[at : at + data.draw(st.integers(1, 40))]
    code = data.draw(st.sampled_from([0, 2]))
    try:
        block = parse_block(maker.block([bytes(envelope)], codes=[code]).SerializeToString())
    except BlockError:
        assert code == 0
        return
    (transaction,) = block.transactions
    _ = (transaction.event, list(transaction.writes), transaction.endorsers, block.config)
    assert data_hash(block.envelopes) == block.header.data_hash


@MODERATE
@given(st.data())
def test_truncation_is_a_typed_error(maker, data):
    whole = maker.block([maker.transaction()]).SerializeToString()
    cut = whole[: data.draw(st.integers(0, len(whole) - 1))]
    try:
        block = parse_block(cut)
    except BlockError:
        return
    assert block.transactions[0].validation_name in {"NOT_VALIDATED", "VALID"}  # only metadata was lost


@MODERATE
@given(st.lists(st.binary(max_size=60), min_size=1, max_size=5))
def test_damaged_signatures_are_a_typed_error(maker, slots):
    message = maker.block([maker.transaction()])
    message.metadata.metadata[0] = b"".join(slots)
    with contextlib.suppress(BlockError):
        block_signatures(parse_block(message))
