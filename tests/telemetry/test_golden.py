"""What pads and drones say, byte for byte what they said before the messages were structs (golden.json)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from kit import said

from wonderland import telemetry
from wonderland.proofs import encoding
from wonderland.proofs.records.sessions import STEP_NAMES

HERE = Path(__file__).parent

GOLDEN: dict[str, list[Any]] = json.loads((HERE / "golden.json").read_text())
SERVER = [
    (telemetry.Challenge(nonce="n", server="wonderland", t_ms=5), '{"type":"challenge","nonce":"n","server":"wonderland","t_ms":5}'),
    (telemetry.Welcome(acknowledged=0), '{"type":"welcome","acknowledged":0}'),
    (telemetry.Refused(code="bad_frame", message="é\n"), '{"type":"refused","code":"bad_frame","message":"é\\n"}'),
    (telemetry.Ack(seq=7), '{"type":"ack","seq":7}'),
    (telemetry.Rejected(seq=7, code="clock", message="m"), '{"type":"rejected","seq":7,"code":"clock","message":"m"}'),
    (
        telemetry.PleaseProve(request_id="0" * 32, pad_id="p", action="land", expires_ms=1),
        '{"type":"please_prove","request_id":"' + "0" * 32 + '","pad_id":"p","action":"land","expires_ms":1}',
    ),
]  # fmt: skip


def bodies() -> list[tuple[str, str]]:
    """(kind, text) of every body there is."""
    kinds = {kind: texts for kind, texts in GOLDEN.items() if kind in telemetry.BODIES}
    return [(kind, text if isinstance(text, str) else text[1]) for kind, texts in kinds.items() for text in texts]


async def test_agents_say_what_they_said_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wonderland_edge_agent.health.__version__", "0.1.0")
    now = await said.everything(lambda body: telemetry.canonical(body).decode())
    now["drone"] = [json.loads(text) for text in now["drone"]]  # they were written with spaces
    before = GOLDEN | {"drone": [json.loads(text) for text in GOLDEN["drone"]]}
    assert json.loads(json.dumps(now)) == before


@pytest.mark.parametrize(("message", "text"), SERVER)
def test_the_server_says_what_it_said_before(message: Any, text: str) -> None:
    assert telemetry.encode(message) == text
    assert telemetry.decode_server(text) == message


@pytest.mark.parametrize(("kind", "text"), bodies())
def test_what_is_encoded_is_decoded_and_canonical(kind: str, text: str) -> None:
    record = telemetry.Record(seq=1, kind=kind, t_ms=said.T0, body=msgspec.Raw(text.encode()))
    body = telemetry.decode_body(record)
    assert telemetry.canonical(body).decode() == text
    assert encoding.encode(telemetry.plain(body)).decode() == text
    again = telemetry.record_of(1, said.T0, body)
    assert telemetry.decode_record(msgspec.Raw(telemetry.canonical(again))) == again == record


def test_each_kind_has_its_golden_message() -> None:
    kinds = {kind for kind, _ in bodies()}
    assert kinds | {"position", "dropped"} == set(telemetry.BODIES), "these two are in drone and in the spool's tests"


def test_steps_have_the_names_that_records_have() -> None:
    from typing import get_args

    assert get_args(telemetry.StepName) == STEP_NAMES


def test_a_spool_of_before_is_sent_as_it_is() -> None:
    """Bodies on a pad's disk are canonical JSON already, whoever wrote them: they go out byte for byte."""
    from wonderland.telemetry import Credentials
    from wonderland_edge_agent.spool import StoredRecord
    from wonderland_edge_agent.uplink import UplinkProtocol

    who = Credentials(agent="pad", id="pad-1", msp_id="PadMSP", certificate_pem="x", sign=lambda text: text[:70])
    protocol = UplinkProtocol(who, "ab" * 16)
    protocol.receive(json.dumps({"type": "challenge", "nonce": said.NONCE, "server": "wonderland"}))
    protocol.receive('{"type":"welcome","acknowledged":0}')
    stored = [StoredRecord(seq, kind, said.T0, text.encode()) for seq, (kind, text) in enumerate(bodies(), 1)]
    parts = [
        f'{{"body":{each.body.decode()},"kind":"{each.kind}","seq":{each.seq},"t_ms":{each.t_ms}}}' for each in stored
    ]
    assert protocol.records(stored) == f'{{"records":[{",".join(parts)}],"type":"records"}}'
