from __future__ import annotations

import ast
import json
import random
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import wonderland_chaincode.contract
from wonderland.proofs import encoding
from wonderland.proofs.records import keys
from wonderland.proofs.records.transactions import ROLES, TRANSACTIONS
from wonderland_chaincode.contract import CONTRACT, ContractError
from wonderland_chaincode.contract.dispatch import HANDLERS
from wonderland_chaincode.contract.errors import MAX_TEXT

STATUSES = {200, 400, 403, 404, 409, 422}
AUTHORITY_ROLES = ("admin", "inspector", "mirror")


def test_every_transaction_has_its_handler():
    assert set(HANDLERS) == set(TRANSACTIONS)
    assert (CONTRACT.name, CONTRACT.version) == ("pol", "1.0")


def test_an_unknown_function_is_told_which_there_are(empty):
    error = empty.refuse(404, "FUNCTION_UNKNOWN", empty.admin, "DropTables")
    assert all(name in str(error) for name in TRANSACTIONS)


@pytest.mark.parametrize("args", [[], [b"{}", b"{}"]])
def test_one_argument(empty, args):
    with pytest.raises(ContractError, match=r"^ONE_ARGUMENT: .*one argument") as caught:
        empty.raw(empty.admin, "ReadPad", args)
    assert caught.value.status == 400


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "not JSON"),
        (b"\xff", "not UTF-8"),
        (b"[]", "expected an object"),
        (b"null", "null"),
        (b'{"pad_id":"a","pad_id":"b"}', "twice"),
        (b'{"pad_id":1.0}', "not an integer"),
        (b'{"pad_id":7}', "pad_id: expected a string"),
        (b'{"pad_id":"a","x":1}', "x: unknown field"),
        (b"{}", "pad_id: missing"),
        (b'{"pad_id":"a\\u0000b"}', "pad_id: "),
        (b"[" * 100_000, "deeper"),
        (b" " * (1 << 20) + b"{}", "more than"),
    ],
)
def test_a_bad_argument_is_refused_by_name(empty, data, said):
    with pytest.raises(ContractError, match=r"^BAD_ARGUMENT: ") as caught:
        empty.raw(empty.admin, "ReadPad", [data])
    assert caught.value.status == 400
    assert said in str(caught.value)


def test_refusals_fit_a_line_of_a_log(empty):
    name = "\n2026 root logged in\x1b[2J" + "é" * 2000
    for function, data in ((name, b"{}"), ("ReadPad", encoding.encode({name: 1}))):
        with pytest.raises(ContractError) as caught:
            empty.raw(empty.admin, function, [data])
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < MAX_TEXT + 40


@pytest.mark.parametrize("function", sorted(TRANSACTIONS))
def test_only_the_listed_roles_of_the_right_organisation(empty, function):
    """Each role of each organisation: refused before anything is read, or let in to have its argument looked at."""
    allowed = TRANSACTIONS[function].roles
    for role in (*ROLES, "", "Admin", "root"):
        for msp_id in ("AuthorityMSP", "PadMSP", "FleetMSP"):
            who = empty.person(empty.admin, role=role, msp_id=msp_id)
            if role not in ROLES:
                expected = (403, "ROLE_MISSING")
            elif role in AUTHORITY_ROLES and msp_id != "AuthorityMSP":
                expected = (403, "ROLE_OF_OTHER_ORGANISATION")
            elif role not in allowed:
                expected = (403, "ROLE_NOT_ALLOWED")
            else:
                expected = (400, "BAD_ARGUMENT")
            empty.refuse(*expected, who, function, {"no such field": 1})
            assert empty.last is not None
            assert empty.last.reads == 0


def test_state_of_another_version_is_said_to_be_so(scene):
    key = keys.composite(keys.PAD, "pad-1")
    for data in (b"\x00", b"{}", scene.state[key].replace(b"commissioned", b"in_orbit")):
        scene.state[key] = data
        scene.refuse(500, "STATE_UNREADABLE", scene.admin, "ReadPad", pad_id="pad-1")


def test_queries_write_nothing_and_emit_nothing(scene):
    session = scene.request()
    scene.submit(session)
    scene.call(scene.uav, "CreateAsset", id="a", type="t", media_type="a/b", value="")
    events = len(scene.events)
    for function, argument in (
        ("ReadPad", {"pad_id": "pad-1"}),
        ("ReadUav", {"uav_id": "1AB0000001"}),
        ("ReadSession", {"session_id": session["session_id"]}),
        ("ReadVerdict", {"session_id": session["session_id"]}),
        ("ReadPolicy", {"pad_id": "pad-1", "action": "land"}),
        ("ListPrekeys", {"pad_id": "pad-1"}),
        ("ReadAsset", {"id": "a"}),
        ("AssetHistory", {"id": "a"}),
    ):
        scene.call(scene.mirror, function, argument)
        assert not scene.last.writes
    assert len(scene.events) == events


# the same everywhere


def _shuffled(value, rng):
    """The same JSON value with the keys of its objects in another order."""
    if isinstance(value, dict):
        items = list(value.items())
        rng.shuffle(items)
        return {key: _shuffled(item, rng) for key, item in items}
    if isinstance(value, list):
        return [_shuffled(item, rng) for item in value]
    return value


def test_two_endorsers_write_the_same_bytes(make_scene):
    """Whatever the order of keys, the spacing of the text, and the order in which the state was filled."""

    def play(seed):
        rng = random.Random(seed)
        scene = make_scene()
        trace = []
        plain = scene.raw

        def raw(who, function, args):
            value = json.loads(args[0])
            if seed:
                args = [json.dumps(_shuffled(value, rng), indent=rng.choice([None, 1]), ensure_ascii=False).encode()]
                items = list(scene.state.items())
                rng.shuffle(items)
                scene.state = dict(items)
            result = plain(who, function, args)
            trace.append((function, result, sorted(scene.last.writes.items()), scene.last.event))
            return result

        scene.raw = raw
        scene.ready()
        session = scene.request()
        evidence = scene.evidence(session)
        # ECDSA draws a number for each signature; what is compared is the contract, given the same one.
        evidence["uav_signature"] = signature.setdefault("it", evidence["uav_signature"])
        scene.submit(session, evidence)
        scene.call(scene.uav, "CompleteInteraction", session_id=session["session_id"], result="done")
        scene.call(scene.uav, "CreateAsset", id="a", type="t", media_type="a/b", value="{ }")
        return trace

    signature: dict[str, str] = {}
    first = play(0)
    assert len(first) == 10
    for seed in range(1, 5):
        assert play(seed) == first


# anything at all


def _status(call):
    try:
        call()
    except ContractError as error:
        return error.status
    return 200


ANY_JSON = st.recursive(
    st.booleans() | st.integers(-(2**53), 2**53) | st.text(max_size=12) | st.none() | st.floats(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


@settings(deadline=None, derandomize=True, max_examples=200, suppress_health_check=[HealthCheck.too_slow])
@given(
    function=st.sampled_from(sorted(TRANSACTIONS)) | st.text(max_size=20),
    args=st.lists(
        st.binary(max_size=60) | ANY_JSON.map(lambda value: json.dumps(value).encode("utf-8", "surrogatepass")),
        max_size=2,
    ),
    role=st.sampled_from(ROLES) | st.text(max_size=5),
    pol_id=st.text(max_size=8),
)
def test_whatever_is_sent_is_answered_or_refused_by_name(make_scene, function, args, role, pol_id):
    scene = make_scene()
    who = scene.person(scene.admin, role=role, pol_id=pol_id)
    assert _status(lambda: scene.raw(who, function, args)) in STATUSES


def _examples(scene):
    session = scene.request("k1")
    yield scene.operator, "RegisterPad", scene.pad_argument("pad-7", note="n")
    yield scene.operator, "UpdatePad", {"pad_id": "pad-1", "name": "x"}
    yield scene.operator, "CommissionPad", {"pad_id": "pad-1", "commissioning": scene.commissioning()}
    yield (
        scene.pad,
        "PublishPrekeys",
        {"pad_id": "pad-1", "prekeys": [{"prekey_id": "z", "public_key": scene.point(3)}]},
    )
    yield scene.fleet, "RegisterUav", scene.uav_argument("U7")
    yield scene.fleet, "RecordMaintenance", scene.maintenance()
    yield scene.admin, "SetUavStatus", {"uav_id": "1AB0000001", "status": "suspended", "reason": "x"}
    yield scene.admin, "GrantAuthorisation", scene.authorisation(authorisation_id="a7")
    yield scene.admin, "ProposePolicy", {"pad_id": "*", "action": "*", "policy": session["policy"]}
    yield scene.uav, "RequestProof", scene.request_argument("k2")
    yield scene.pad, "SubmitProof", {"session_id": session["session_id"], "evidence": scene.evidence(session)}
    yield scene.inspector, "CalibrateUav", scene.calibration(session["session_id"])
    yield scene.uav, "ReportLanding", {"pad_id": "pad-1", "cause": "pilot", "claim": scene.claim()}
    yield scene.operator, "GivePrecedence", {"session_id": session["session_id"], "reason": "x"}
    yield scene.pad, "RecordDeparture", {"session_id": session["session_id"], "note": "x"}
    span = {"from_ms": scene.now_ms, "until_ms": scene.now_ms + 60_000}
    yield scene.uav, "ReservePad", {"pad_id": "pad-1", "uav_id": "1AB0000001"} | span
    yield scene.operator, "CancelReservation", {"pad_id": "pad-1", "reservation_id": "0" * 64, "note": "x"}
    yield scene.uav, "CancelProof", {"session_id": session["session_id"], "reason": "x"}
    yield scene.uav, "CreateAsset", {"id": "a", "type": "t", "media_type": "a/b", "value": "v"}


def _places(value, path=()):
    yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _places(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value[:3]):
            yield from _places(item, (*path, index))


def _with(value, path, new):
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = _with(value[path[0]], path[1:], new)
    return copy


@settings(deadline=None, derandomize=True, max_examples=120, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_a_good_argument_with_one_thing_wrong_is_answered_or_refused_by_name(make_scene, data):
    scene = make_scene().ready()
    who, function, argument = data.draw(st.sampled_from(list(_examples(scene))), label="transaction")
    path = data.draw(st.sampled_from(list(_places(argument))), label="place")
    new = data.draw(
        st.integers(-(2**53) + 1, 2**53 - 1)
        | st.sampled_from([-1, 0, 1, True, "", "x", "*", [], {}, "A" * 87, "0" * 64])
        | st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=12),
        label="instead",
    )
    changed = encoding.encode(_with(argument, path, new))
    assert _status(lambda: scene.raw(who, function, [changed])) in STATUSES


# no refusal without its test and its line in the reference

STATUS_OF = {"bad_input": 400, "not_allowed": 403, "not_there": 404, "conflict": 409, "refused": 422}


def _codes():
    """Code and status of every refusal in the contract's source."""
    found = {(f"SESSION_{state}", 422) for state in ("REQUESTED", "DECIDED", "COMPLETED", "CANCELLED")}
    for path in Path(wonderland_chaincode.contract.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in STATUS_OF:
                assert isinstance(node.args[0], ast.Constant), ast.unparse(node)
                found.add((node.args[0].value, STATUS_OF[node.func.id]))
    return found | {("STATE_UNREADABLE", 500)}


def test_every_refusal_has_its_test():
    tests = "".join(path.read_text("utf-8") for path in Path(__file__).parent.glob("test_*.py"))
    codes = {code for code, _ in _codes()}
    assert len(codes) > 50
    assert not {code for code in codes if f'"{code}"' not in tests and f'r"^{code}: ' not in tests}


def test_the_reference_lists_every_refusal():
    page = Path(__file__).parents[2].joinpath("docs", "reference", "refusals.md").read_text("utf-8")
    listed = {(code, int(status)) for code, status in re.findall(r"^\| `([A-Z_]+)` \| (\d+) \|", page, re.MULTILINE)}
    assert listed == _codes()
