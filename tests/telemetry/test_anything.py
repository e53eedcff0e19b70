"""Whatever comes in: a message of this protocol, or a `TelemetryError` that says what is wrong with it."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from kit import said

from wonderland import telemetry
from wonderland.proofs import encoding
from wonderland.telemetry import TelemetryError
from wonderland_backend.agents.connected import Agent
from wonderland_backend.ingest.batch import read
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.session import actions as do

T0 = 1_760_000_400_000
DRIP = {"state": "verified", "det": "2001:30:280:1405:1:2:3:4", "format": "wrapper", "t_ms": T0}
TRACK: dict[str, Any] = {
    "uav_id": "uav-1",
    "lat_e7": 604_518_000,
    "lon_e7": 222_666_000,
    "height_mm": 42_000,
    "accuracy_mm": 3_000,
    "transport": "wifi",
    "transports": ["wifi", "ble4"],
    "drip": DRIP,
}
END = {"session_id": "0" * 64, "state": "decided", "steps": [{"step": "poll", "t_ms": 1}], "signature": DRIP}
ESTIMATE = {
    "session_id": "0" * 64, "uav_id": "u", "lat_e7": 1, "lon_e7": 1, "east_mm": 1, "north_mm": 1, "ee_mm2": 1,
    "en_mm2": 1, "nn_mm2": 1, "rounds": 1, "likelihood_ppm": 1, "ranges": {"A0": 1},
}  # fmt: skip
HEALTH = {"anchors": [{"anchor_id": "A0", "state": "up"}], "spool": {"records": 1, "bytes": 1, "dropped": 0}}
BODIES = {
    "track": TRACK,
    "session_end": END,
    "estimate": ESTIMATE,
    "health": HEALTH,
    "finding": {"uav_id": "u", "kind": "time_off"},
    "dropped": {"from_seq": 1, "to_seq": 2},
    "step": {"session_id": "0" * 64, "uav_id": "u", "step": "poll", "t_ms": 1, "ok": True},
    "position": {
        "lat_e7": 1, "lon_e7": 1, "height_mm": 1, "accuracy_mm": 1, "height_accuracy_mm": 1, "claim_t_ms": 1,
    },
}  # fmt: skip
SLOW = [HealthCheck.too_slow, HealthCheck.filter_too_much]

literals = st.sampled_from(
    [
        "null", "true", "false", "-0", "1.0", "1e0", "1e400", "NaN", "-Infinity", "9" * 30, "9" * 5_000, "18446744073709551616",
        '"1"', '"\\ud800"', '"\\udc00x"', '"\\u0000"', '"a\\n"', '"\\x"', '"\t"', "01", "+1", "tru", "'a'", "[1,]", "{", "]", "",
        "[" * 150 + "]" * 150, "[" * 20_000 + "]" * 20_000, "{" * 20_000, '{"a":1,"a":"x"}', '"\ud800"',
    ]
)  # fmt: skip
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
    max_leaves=12,
).map(json.dumps)


@st.composite
def mutated_bodies(draw: st.DrawFn) -> tuple[str, str]:
    """(kind, JSON text) of a good body with one value replaced, at any depth; or two, or a field too many."""
    kind = draw(st.sampled_from(sorted(BODIES)))
    body = json.loads(json.dumps(BODIES[kind]))
    where = body
    while True:
        key = draw(st.sampled_from(sorted(where) if isinstance(where, dict) else range(len(where))))
        if isinstance(where[key], dict | list) and where[key] and draw(st.booleans()):
            where = where[key]
            continue
        break
    where[key] = "@@"
    if isinstance(where, dict) and draw(st.booleans()):
        where[draw(st.text(max_size=50))] = "@@"
    return kind, json.dumps(body).replace('"@@"', draw(literals | json_values))


def taken(text: str) -> Any:
    """What the backend makes of a frame of a pad; the only error that may come out is a `TelemetryError`."""
    frame = telemetry.decode_agent(text)
    if isinstance(frame, telemetry.Records):
        return read(Agent("pad", "pad-1", "0" * 32, ""), frame.records, acknowledged=0, now_ms=T0)
    return frame


def check(problem: TelemetryError) -> None:
    """What is wrong can be sent, logged and kept: bounded, without controls, in UTF-8."""
    assert len(problem.message) <= 300
    assert problem.message
    assert problem.message.isprintable() or "\ufffd" in problem.message or not problem.message.isascii()
    assert not any(ord(each) < 0x20 or each == "\x7f" for each in problem.message)
    telemetry.encode(telemetry.Refused(code=problem.code, message=problem.message)).encode()


def taken_or_none(text: str) -> Any:
    """The same; None where nothing of the frame can be used."""
    problems: list[TelemetryError] = []
    batch = None
    try:
        batch = taken(text)
    except TelemetryError as problem:
        problems.append(problem)
    for problem in problems:
        assert problem.code == "bad_frame"
        check(problem)
    return batch


@given(st.text(max_size=200) | json_values | literals)
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_message_or_an_error(text: str) -> None:
    for decode in (telemetry.decode_hello, telemetry.decode_agent, telemetry.decode_server, taken):
        with pytest.raises(TelemetryError) as problem:
            decode(text)
        check(problem.value)


@given(st.binary(max_size=100))
@example(b"\xff")
@example(b'{"type":"\xff"}')
@example(b'{"type":"refused","code":"\xed\xa0\x80"}')
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_a_message_or_an_error(data: bytes) -> None:
    for decode in (telemetry.decode_agent, telemetry.decode_server):
        with pytest.raises(TelemetryError) as problem:
            decode(data)
        check(problem.value)


@given(mutated_bodies())
@settings(max_examples=600, deadline=None, suppress_health_check=SLOW)
def test_any_body_is_one_of_its_kind_or_refused(mutated: tuple[str, str]) -> None:
    kind, body = mutated
    text = f'{{"type":"records","records":[{{"seq":1,"kind":"{kind}","t_ms":{T0},"body":{body}}}]}}'
    batch = taken_or_none(text)
    if batch is None:
        return
    assert batch.last_seq == 1
    for seq, code, message in batch.rejected:
        assert (seq, code in {"bad_body", "bad_record", "unknown_kind", "not_allowed"}) == (1, True)
        check(TelemetryError(code, message))
    for row in batch.irregular:
        assert "\x00" not in row["body"] + row["message"]
        assert len(row["body"]) <= 4_096


@given(st.sampled_from(["seq", "kind", "t_ms", "body", "more"]), literals | json_values)
@settings(max_examples=300, deadline=None, suppress_health_check=SLOW)
def test_any_record_is_one_or_refused(name: str, value: str) -> None:
    record = {"seq": "1", "kind": '"track"', "t_ms": str(T0), "body": json.dumps(TRACK)} | {name: value}
    text = ",".join(f'"{key}":{each}' for key, each in record.items())
    batch = taken_or_none(f'{{"type":"records","records":[{{{text}}}]}}')
    if batch is not None:
        assert len(batch.rejected) + len(batch.tracks) + len(batch.irregular) in {1, 2}
        assert batch.last_seq >= 1


@given(st.text(max_size=40), st.sampled_from(["detail", "state"]))
@settings(max_examples=200, deadline=None)
def test_texts_are_canonical(text: str, name: str) -> None:
    body = telemetry.Step(session_id="0" * 64, uav_id="u", step="poll", t_ms=1, ok=True, detail=text)
    if name == "state":
        body = telemetry.SessionEnd(session_id="0" * 64, state=text, steps=())
    assert telemetry.canonical(body) == encoding.encode(telemetry.plain(body))


@pytest.mark.parametrize(
    ("kind", "change", "says"),
    [
        ("track", {"lat_e7": 910_000_000}, "lat_e7: Expected `int` <= 900000000"),
        ("track", {"lat_e7": True}, "lat_e7: Expected `int`, got `bool`"),
        ("track", {"lat_e7": 1.0}, "lat_e7: Expected `int`, got `float`"),
        ("track", {"lat_e7": "1"}, "lat_e7: Expected `int`, got `str`"),
        ("track", {"colour": "red"}, "Object contains unknown field `colour`"),
        ("track", {"co\nlour": "red"}, "Object contains unknown field `co\ufffdlour`"),
        ("track", {"drip": DRIP | {"det": "x\n"}}, "drip.det: Expected `str` matching regex"),
        ("track", {"transport": "a\n"}, "transport: Expected `str` matching regex"),
        ("track", {"transports": ["a"] * 9}, "transports: Expected `array` of length <= 8"),
        ("estimate", {"ranges": {"A 0": 1}}, "ranges"),
        ("estimate", {"ranges": {f"A{each}": 1 for each in range(17)}}, "ranges: Expected `object` of length <= 16"),
        ("session_end", {"steps": [{"step": "fly", "t_ms": 1}]}, "steps[0].step: Invalid enum value 'fly'"),
    ],
)
def test_what_is_wrong_is_said_by_field(kind: str, change: dict[str, Any], says: str) -> None:
    body = msgspec.Raw(json.dumps(BODIES[kind] | change))
    with pytest.raises(TelemetryError) as problem:
        telemetry.decode_body(telemetry.Record(seq=1, kind=kind, t_ms=T0, body=body))
    assert problem.value.code == "bad_body"
    assert problem.value.message.startswith(says), problem.value.message


def decoded(kind: str, **change: Any) -> Any:
    body = msgspec.Raw(json.dumps(BODIES[kind] | change))
    return telemetry.decode_body(telemetry.Record(seq=1, kind=kind, t_ms=T0, body=body))


def test_a_link_is_never_more_than_an_endorsement() -> None:
    assert decoded("track", drip=DRIP | {"format": "link"}).drip.state == "endorsed"
    assert decoded("session_end", signature=DRIP | {"format": "link", "refused": 1}).signature.state == "endorsed"
    assert decoded("track").drip.state == "verified"


async def test_texts_of_others_making_do_not_cost_the_evidence() -> None:
    """A step's detail may quote an exception of several lines, or a file's name that is no UTF-8."""
    spool = said.FakeSpool()
    reporter = SpoolReporter(spool)
    reporter.step(said.SESSION, do.ReportStep("range", T0, ok=False, detail="no port\n/dev/tty\udcff\x7f"))
    await reporter.drain()
    [(kind, _, body)] = spool.kept
    found = telemetry.decode_body(telemetry.Record(seq=1, kind=kind, t_ms=T0, body=msgspec.Raw(body)))
    assert found.detail == "no port\ufffd/dev/tty\ufffd\ufffd"
    telemetry.encode(telemetry.Answer(request_id="0" * 32, accepted=False, text=telemetry.clean("\udcff" * 400, 300)))


def test_an_operators_secret_goes_no_further() -> None:
    assert decoded("track", operator_id="FIN87astrdge12k8-xyz").operator_id == "FIN87astrdge12k8"
    assert telemetry.Track(uav_id="u", lat_e7=0, lon_e7=0, transport="x", operator_id="ab-xyz").operator_id == "ab"
