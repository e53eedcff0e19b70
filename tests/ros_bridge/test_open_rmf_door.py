"""The door's pure half: open by permissions alone, whatever is wished, in whatever order."""

from __future__ import annotations

import contextlib
import os
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.facts import Facts
from kit.proof_world import World
from kit.ros2 import TYPES
from rosbags.typesys import get_types_from_msg

from wonderland.asset_contract import CommittedEvent
from wonderland.proofs.queue import COMPLETION_MS, queue_of
from wonderland_rmw_zenoh.errors import Ros2Error, WireError
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Arrived
from wonderland_rmw_zenoh.wire import Attachment
from wonderland_ros_bridge.ros2 import door as says
from wonderland_ros_bridge.ros2.door import CLOSED, MAX_WISHES, MOVING, OFFLINE, OPEN, WISH_MS, Wishes
from wonderland_ros_bridge.ros2.interfaces_command import DIRECTORIES
from wonderland_ros_bridge.ros2.open_rmf import OpenRmf
from wonderland_ros_bridge.ros2.settings import OpenRmfSettings

NOW = World().start_ms + 5_000
_BASE = World().session(World().claim((0, 0, 3_000), NOW))
OPEN_RMF = DIRECTORIES[1]
OURS = sorted(OPEN_RMF.glob("rmf_*/msg/*.msg"))
requesters = st.sampled_from(("a", "b", "c")) | st.text(min_size=1, max_size=8)


def session(number, state, decided_ms=None, expires_ms=NOW + 50_000, **more):
    occupied = replace(_BASE.policy, occupied_ms=600_000)
    ended = {"end": "done", "ended_ms": NOW - 500, "ended_by": "uav"} if state == "completed" else {}
    return replace(
        _BASE,
        session_id=f"{number:064x}",
        uav_id=f"uav-{number}",
        policy=occupied,
        state=state,
        decided_ms=decided_ms,
        expires_ms=expires_ms,
        **(ended | more),
    )


sessions = st.lists(
    st.tuples(
        st.sampled_from(("requested", "decided", "completed", "cancelled")),
        st.integers(NOW - 200_000, NOW),
        st.integers(NOW - 100_000, NOW + 100_000),
        st.booleans(),
    ),
    max_size=5,
)


@given(found=sessions, wished=st.booleans())
def test_open_is_what_a_permission_that_holds_makes_it(found, wished):
    made = [session(index, *each[:3]) for index, each in enumerate(found)]
    granted = {one.session_id for one, each in zip(made, found, strict=True) if each[3]}
    holds = [
        each
        for each in made
        if each.state == "decided"
        and each.session_id in granted
        and max(each.expires_ms, each.decided_ms + COMPLETION_MS) > NOW
    ]
    queue = queue_of(made, granted, NOW)
    got = says.mode(queue, wished=wished)
    assert (got == OPEN) == bool(holds)
    asked = any(each.state == "requested" and each.expires_ms > NOW for each in made)
    if not holds:
        assert got == (MOVING if wished or asked else CLOSED)
    assert says.mode(None, wished=wished) == OFFLINE


def test_a_landed_drone_leaves_the_door_closed_and_is_first_in_the_queue():
    queue = queue_of([session(1, "completed"), session(2, "requested")], (), NOW)
    assert queue.occupant.landed
    assert says.mode(queue_of([session(1, "completed")], (), NOW), wished=False) == CLOSED
    assert says.permitted(queue) is None
    shown = says.ingestor_state(NOW, "pad-1", queue)
    assert [each.split()[0] for each in shown["request_guid_queue"]] == ["uav-1", "uav-2"]
    assert shown["seconds_remaining"] > 500
    assert says.ingestor_state(NOW, "pad-1", None)["mode"] == 2
    TYPES.message("rmf_ingestor_msgs/msg/IngestorState").codec.encode(shown)


@given(
    st.lists(
        st.tuples(st.sampled_from(("ask", "release", "answer", "wait")), requesters, st.integers(0, WISH_MS)),
        max_size=40,
    )
)
def test_wishes_are_few_and_forgotten(steps):
    wishes, model, now = Wishes(), {}, NOW
    for do, who, wait_ms in steps:
        model = {each: kept for each, kept in model.items() if now < kept[0]}
        if do == "ask":
            assert wishes.ask(who, now) == (who not in model)
            model[who] = (now + WISH_MS, model.get(who, (0, False))[1])
        elif do == "release":
            wishes.held(now)
            assert wishes.release(who) == (model.pop(who, None) is not None)
        elif do == "answer":
            wishes.answer()
            model = {each: (until, True) for each, (until, _) in model.items()}
        else:
            now += wait_ms
        expected = {each: kept for each, kept in model.items() if now < kept[0]}
        assert set(wishes.held(now)) == set(expected)
        assert set(wishes.held(now, answered=False)) == {each for each, kept in expected.items() if not kept[1]}


def test_of_too_many_wishes_the_one_that_was_not_repeated_goes():
    wishes = Wishes()
    wishes.ask("robot", NOW)
    for index in range(1_000):
        wishes.ask(f"liar {index}", NOW)
        wishes.ask("robot", NOW)
    held = wishes.held(NOW)
    assert len(held) == MAX_WISHES
    assert "robot" in held
    assert wishes.held(NOW + WISH_MS) == ()


def test_the_pads_number_is_no_robots_and_not_nobodys():
    numbers = {says.claimant(f"pad-{index}") for index in range(1_000)}
    assert len(numbers) == 1_000
    assert all(1 << 63 <= each < (1 << 64) - 1 for each in numbers)


@pytest.mark.parametrize(
    ("more", "says_so"),
    [
        ({"end": "no_reply", "ended_by": "pad"}, True),
        ({"end": "turned_away", "ended_by": "operator"}, True),
        ({"end": "some_day_new", "ended_by": "authority"}, True),
        ({"end": None, "ended_by": None}, True),
        ({"end": "aborted", "ended_by": "uav"}, False),
        ({"end": "queue_timeout", "ended_by": "pad"}, False),
        ({"end": "agent_restart", "ended_by": "pad"}, False),
    ],
)
def test_what_breaks_off_is_an_alert_unless_it_is_the_drones_own_will_or_keeps_its_place(more, says_so):
    event = CommittedEvent("ProofCancelled", "f" * 64, NOW, "PadMSP/pad", {}, None)
    found = says.broken_off("pad-1", session(1, "cancelled", **more), event)
    assert (found is not None) == says_so
    if found is not None:
        assert found["tier"] == 1
        assert found["message"]
        assert "_" not in found["message"]
        TYPES.message("rmf_task_msgs/msg/Alert").codec.encode(found)


@pytest.mark.parametrize(("outcome", "tier"), [("refuted", 2), ("inconclusive", 1), ("verified", 1)])
def test_a_refusal_says_why(outcome, tier):
    """A drone that was where it said may lack papers."""
    event = CommittedEvent("ProofDecided", "f" * 64, NOW, "PadMSP/pad", {}, None)
    reasons = [{"code": "anchor_rarely", "facts": {"anchor_id": "A1"}}, {"code": "of_a_later_contract", "facts": {}}]
    verdict = Facts.verdict("e" * 64, outcome=outcome, permission="refused", reasons=reasons)
    found = says.refusal("roof", verdict, event)
    assert (found["title"], found["subtitle"], found["tier"]) == ("roof: uav-1 was refused", f"land: {outcome}", tier)
    assert found["message"].splitlines() == [
        "A1 is left out: it measured in too few of the rounds.",
        "of_a_later_contract",
    ]
    TYPES.message("rmf_task_msgs/msg/Alert").codec.encode(found)


@given(st.binary(max_size=120) | st.binary(max_size=60).map(lambda data: b"\x00\x01\x00\x00" + data))
async def test_any_bytes_are_a_request_or_refused(data):
    kind = TYPES.message("rmf_door_msgs/msg/DoorRequest")
    made = OpenRmf(OpenRmfSettings(), None, TYPES, "pad-1", lambda: NOW, lambda: True)
    arrived = Arrived("/door_requests", kind.name, kind.hash, data, Attachment(1, 2, b"g" * 16), 0)
    with contextlib.suppress(Ros2Error):
        await made._requested(arrived, kind)
    assert made.mode == OFFLINE


@pytest.mark.parametrize(
    ("more", "says_so"),
    [
        ({"requester_id": ""}, "printable letters"),
        ({"requester_id": "x" * 201}, "printable letters"),
        ({"requester_id": "a\x1b[2J"}, "printable letters"),
        ({"requested_mode": {"value": MOVING}}, "another mode"),
        ({"requested_mode": {"value": 4_000_000_000}}, "another mode"),
        ({"door_name": "another", "requester_id": ""}, None),
    ],
)
async def test_a_request_that_is_none_is_refused_in_words(more, says_so):
    kind = TYPES.message("rmf_door_msgs/msg/DoorRequest")
    made = OpenRmf(OpenRmfSettings(), None, TYPES, "pad-1", lambda: NOW, lambda: True)
    data = kind.codec.encode({"door_name": "pad-1", "requester_id": "a", "requested_mode": {"value": OPEN}} | more)
    arrived = Arrived("/door_requests", kind.name, kind.hash, data, Attachment(1, 2, b"g" * 16), 0)
    if says_so is None:
        await made._requested(arrived, kind)
    else:
        with pytest.raises(WireError, match=says_so):
            await made._requested(arrived, kind)
    assert made._wishes.held(NOW) == ()


def test_modes_are_those_of_the_definitions():
    def constants(package, name):
        text = (OPEN_RMF / package / "msg" / f"{name}.msg").read_text()
        return {
            each[0]: each[2] for each in get_types_from_msg(text, f"{package}/msg/{name}")[f"{package}/msg/{name}"][0]
        }

    door = constants("rmf_door_msgs", "DoorMode")
    assert [door[f"MODE_{each.upper()}"] for each in says.MODES] == [CLOSED, MOVING, OPEN, OFFLINE]
    assert constants("rmf_fleet_msgs", "MutexGroupRequest") == {"MODE_RELEASE": says.RELEASE, "MODE_LOCK": says.LOCK}
    assert list(constants("rmf_ingestor_msgs", "IngestorState").values()) == [says.IDLE, says.BUSY, says.AWAY]


@pytest.mark.parametrize("path", OURS, ids=lambda each: each.stem)
def test_definitions_are_rmfs_own(path):
    theirs = Path(os.environ.get("RMF_DIR") or "nowhere") / "rmf_internal_msgs"
    if not theirs.is_dir():
        pytest.skip("RMF_DIR names no directory with rmf_internal_msgs (docs/contributing/tests.md)")
    kind = f"{path.parent.parent.name}/msg/{path.stem}"
    assert TYPES.message(kind).hash == Interfaces([theirs]).message(kind).hash
