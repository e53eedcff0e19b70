"""The agent's side of the ingest protocol without a network: the order of messages, and what a bad server can say."""

from __future__ import annotations

import json
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs import encoding
from wonderland.telemetry import Ack, Credentials, Refused, Rejected, Welcome, signed_text
from wonderland_edge_agent.spool import StoredRecord
from wonderland_edge_agent.uplink import UplinkError, UplinkProtocol, UplinkProtocolError
from wonderland_edge_agent.uplink.protocol import SendHello, State
from wonderland_fabric_gateway.signing import key_signer, verify

KEY = ec.derive_private_key(7, ec.SECP256R1())
CREDENTIALS = Credentials(
    agent="pad", id="pad-1", msp_id="PadMSP", certificate_pem="-----BEGIN CERTIFICATE-----\n", sign=key_signer(KEY)
)
SPOOL = "ab" * 16
NONCE = encoding.to_base64url(bytes(range(32)))
T0 = 1_760_000_400_000


def text(**message: Any) -> str:
    return json.dumps(message)


CHALLENGE = text(type="challenge", nonce=NONCE, server="wonderland", t_ms=T0)


def streaming(acknowledged: int = 0) -> UplinkProtocol:
    protocol = UplinkProtocol(CREDENTIALS, SPOOL)
    protocol.receive(CHALLENGE)
    protocol.receive(text(type="welcome", acknowledged=acknowledged))
    return protocol


def record(seq: int, body: bytes = b'{"n":1}') -> StoredRecord:
    return StoredRecord(seq, "track", T0, body)


def test_the_hello_is_signed_over_what_it_says() -> None:
    protocol = UplinkProtocol(CREDENTIALS, SPOOL, "5a" * 32)
    answer = protocol.receive(CHALLENGE)
    assert isinstance(answer, SendHello)
    hello = json.loads(answer.text)
    signature = encoding.from_base64url(hello.pop("signature"))
    assert hello == {
        "type": "hello",
        "protocol": "wonderland-ingest/1",
        "agent": "pad",
        "id": "pad-1",
        "spool": SPOOL,
        "msp_id": "PadMSP",
        "certificate": "-----BEGIN CERTIFICATE-----\n",
        "tls_server_end_point": "5a" * 32,
    }
    signed = encoding.encode(
        {
            "purpose": "wonderland-ingest",
            "nonce": NONCE,
            "server": "wonderland",
            "agent": "pad",
            "id": "pad-1",
            "spool": SPOOL,
            "tls_server_end_point": "5a" * 32,
        }
    )
    verify(KEY.public_key(), signed, signature)
    assert signed_text(nonce=NONCE, agent="pad", agent_id="pad-1", spool=SPOOL, end_point="5a" * 32) == signed


def test_the_way_through() -> None:
    protocol = UplinkProtocol(CREDENTIALS, SPOOL)
    assert protocol.state is State.CHALLENGE
    protocol.receive(CHALLENGE)
    assert protocol.receive(text(type="welcome", acknowledged=41)) == Welcome(acknowledged=41)
    frame = json.loads(protocol.records([record(42), record(45, b'{"x":"\xc3\xa4\\"}"}')]))
    assert frame == {
        "type": "records",
        "records": [
            {"seq": 42, "kind": "track", "t_ms": T0, "body": {"n": 1}},
            {"seq": 45, "kind": "track", "t_ms": T0, "body": {"x": 'ä"}'}},
        ],
    }
    assert protocol.receive(text(type="rejected", seq=42, code="bad_body", message="n")) == Rejected(
        seq=42, code="bad_body", message="n"
    )
    assert protocol.receive(text(type="ack", seq=42)) == Ack(seq=42)
    assert protocol.receive(text(type="ack", seq=45, more="fields are fine")) == Ack(seq=45)
    assert (protocol.sent_seq, protocol.acknowledged_seq) == (45, 45)


def test_a_refusal_may_come_at_any_time() -> None:
    protocol = UplinkProtocol(CREDENTIALS, SPOOL)
    assert protocol.receive(text(type="refused", code="busy")) == Refused(code="busy")
    protocol = UplinkProtocol(CREDENTIALS, SPOOL)
    protocol.receive(CHALLENGE)
    refused = protocol.receive(text(type="refused", code="duplicate_agent", message="another is connected"))
    assert refused == Refused(code="duplicate_agent", message="another is connected")
    with pytest.raises(UplinkProtocolError, match="refused"):
        protocol.records([record(1)])
    assert streaming().receive(text(type="refused", code="revoked")) == Refused(code="revoked")


@pytest.mark.parametrize(
    ("message", "says"),
    [
        ("", "not JSON"),
        ("[]", "`object`, got `array`"),
        (b"\xff", "not JSON"),
        ("{" * 100, "not JSON"),
        ('{"type":1}', "type: "),
        ('{"type":"challenge","nonce":"AA","server":"wonderland"}', "1 bytes"),
        ('{"type":"challenge","nonce":"A A","server":"wonderland"}', "base64url"),
        (text(type="challenge", nonce=NONCE, server="evil"), "'evil'"),
        (text(type="challenge", server="wonderland"), "`nonce`"),
        (text(type="welcome", acknowledged=0), "waiting for the challenge"),
        (text(type="ack", seq=0), "waiting for the challenge"),
        (json.dumps({"type": "x" * 100_000}), "more than 65536"),
    ],
)
def test_what_a_server_cannot_say_first(message: str | bytes, says: str) -> None:
    with pytest.raises(UplinkProtocolError, match=says):
        UplinkProtocol(CREDENTIALS, SPOOL).receive(message)


@pytest.mark.parametrize("acknowledged", [-1, True, "1", None, 2**60])
def test_a_welcome_without_a_number(acknowledged: Any) -> None:
    protocol = UplinkProtocol(CREDENTIALS, SPOOL)
    protocol.receive(CHALLENGE)
    with pytest.raises(UplinkProtocolError):
        protocol.receive(text(type="welcome", acknowledged=acknowledged))


def test_acknowledgements_that_lie() -> None:
    protocol = streaming(10)
    protocol.records([record(11), record(12)])
    with pytest.raises(UplinkProtocolError, match="acknowledged 13, but the last record sent is 12"):
        protocol.receive(text(type="ack", seq=13))
    protocol.receive(text(type="ack", seq=12))
    with pytest.raises(UplinkProtocolError, match="back from 12 to 11"):
        protocol.receive(text(type="ack", seq=11))


def test_records_out_of_order_are_a_mistake_here() -> None:
    protocol = streaming(10)
    with pytest.raises(UplinkProtocolError, match="record 10 would follow record 10"):
        protocol.records([record(10)])
    assert protocol.sent_seq == 10


def test_a_frame_never_exceeds_the_servers_limit() -> None:
    protocol = streaming()
    with pytest.raises(UplinkProtocolError, match="send fewer"):
        protocol.records([record(seq, b'"' + b"x" * 100_000 + b'"') for seq in range(1, 4)])


def test_a_key_that_cannot_sign() -> None:
    def sign(_: bytes) -> bytes:
        raise OSError("token was pulled out")

    protocol = UplinkProtocol(
        Credentials(agent="pad", id="pad-1", msp_id="PadMSP", certificate_pem="", sign=sign), SPOOL
    )
    with pytest.raises(UplinkError, match="token was pulled out"):
        protocol.receive(CHALLENGE)


messages = st.fixed_dictionaries(
    {"type": st.sampled_from(["challenge", "welcome", "ack", "rejected", "refused", "records", ""])},
    optional={
        "nonce": st.text(max_size=50),
        "server": st.sampled_from(["wonderland", "x"]),
        "acknowledged": st.integers(-5, 50) | st.booleans() | st.none(),
        "seq": st.integers(-5, 50) | st.text(max_size=3),
        "code": st.text(max_size=5) | st.integers(),
        "message": st.text(max_size=600),
    },
).map(json.dumps)


@settings(max_examples=300, deadline=None)
@given(st.lists(messages | st.binary(max_size=40) | st.just(CHALLENGE), max_size=8))
def test_whatever_a_server_says_gives_an_event_or_this_packages_error(texts: list[str | bytes]) -> None:
    protocol = UplinkProtocol(CREDENTIALS, SPOOL)
    for one in texts:
        try:
            protocol.receive(one)
        except UplinkProtocolError:
            break
        assert protocol.acknowledged_seq <= protocol.sent_seq
