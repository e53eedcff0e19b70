"""Each row of what was found wrong with the radio plan: boards refuse the old way, or it fails on them; the new one runs.

All of it is in virtual time, with the hosts' own state machines.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from kit.air_duo import AirDuo
from kit.virtual_air import VirtualAir

from wonderland.uwb.agreed import PREAMBLE_CODES_OF_ALL, ability_of
from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan, steps_ms
from wonderland_fira_uci.uci.config import (
    ParameterId,
    RframeConfig,
    ScheduleMode,
    SessionConfig,
    StsConfig,
)
from wonderland_fira_uci.uci.status import Status, TransferStatus
from wonderland_simulator.uci_node import DWM3001CDK, IDEAL, PICA, QM35, SR150, NodeProfile

BOARDS = (DWM3001CDK, QM35, SR150)
PAD = ("A1", "A2", "A3", "A4", "A5", "A6", "A7", "A8")
A, B, C = 0x1000_0001, 0x1000_0002, 0x1000_0003
Make = Callable[..., VirtualAir]


@pytest.fixture
def virtual() -> Iterator[Make]:
    made: list[VirtualAir] = []

    def make(**options: Any) -> VirtualAir:
        made.append(VirtualAir(**options))
        return made[-1]

    yield make
    for each in made:
        each.close()
        each.loop.close()


def plan(anchors: int = 4, **changes: Any) -> RangingPlan:
    values: dict[str, Any] = {
        "session_a_id": A,
        "session_b_id": B,
        "pad_macs": tuple(range(0xA001, 0xA001 + anchors)),
        "uav_mac": 0xD001,
        "sts_key": bytes(range(16)),
    }
    return RangingPlan(**(values | changes))


def changed(config: SessionConfig | None, **changes: Any) -> SessionConfig:
    assert config is not None
    return replace(config, app=replace(config.app, **changes), time_base=None)


# --- what the boards say ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", [DWM3001CDK, QM35, SR150], ids=lambda each: each.name)
def test_what_a_board_says_and_what_it_takes_agree(profile: NodeProfile) -> None:
    said, takes = profile.said(), profile.accepts
    assert said.channels == tuple(sorted(takes[ParameterId.CHANNEL_NUMBER]))
    for parameter, mask in (
        (ParameterId.SCHEDULE_MODE, said.schedule_modes),
        (ParameterId.RANGING_ROUND_USAGE, said.ranging_methods),
        (ParameterId.RFRAME_CONFIG, said.rframe_configs),
        (ParameterId.STS_CONFIG, said.sts_configs),
        (ParameterId.MULTI_NODE_MODE, said.multi_node_modes),
    ):
        assert mask is not None
        for value in takes.get(parameter, frozenset()):
            assert mask >> value & 1, (parameter, value)


@pytest.mark.parametrize(("profile", "blinks"), [(DWM3001CDK, "none"), (QM35, "none"), (SR150, "scheduled")])
def test_a_plan_is_told_what_a_board_can_do(profile: NodeProfile, blinks: str) -> None:
    ability = ability_of(profile.said())
    assert ability is not None
    assert (ability.blinks, ability.sts, ability.channels) == (blinks, "provisioned", (5, 9))


# --- row 1: frames SP3 carry no data ---------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", BOARDS, ids=lambda each: each.name)
def test_words_in_sp3_frames_never_arrive(virtual: Make, profile: NodeProfile) -> None:
    air, plan_ = virtual(), plan()
    air.add("uav", profile)
    for index, name in enumerate(PAD[:4]):
        air.add(name, profile)
        air.open(name, changed(plan_.pad_ranging(index), rframe_config=RframeConfig.SP3))
    air.open("uav", changed(plan_.uav_ranging(), rframe_config=RframeConfig.SP3))
    assert air.send("uav", A, b"hello")
    air.run(500)
    assert len(air.hosts["A1"].records(A)) > 10, "ranging works"
    assert air.hosts["A1"].data(A) == []
    assert TransferStatus.REJECTED in air.hosts["uav"].transfers()


# --- row 2: one radio ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", BOARDS, ids=lambda each: each.name)
def test_two_sessions_that_know_nothing_of_each_other_collide(virtual: Make, profile: NodeProfile) -> None:
    """24 ms of each 50, and 12 of each 100: for 72 of 100 phases every round of the second lies over one of the first."""
    hit = 0
    for phase_ms in random.Random(2).sample(range(100), 10):
        air, plan_ = virtual(), plan(words="initiator")
        for name in (*PAD[:4], "uav"):
            air.add(name, profile)
        for index, name in enumerate(PAD[:4]):
            air.open(name, changed(plan_.pad_ranging(index), interval_ms=50))
        air.open("uav", changed(plan_.uav_ranging(), interval_ms=50), changed(plan_.uav_words(), interval_ms=100))
        air.run(200 + phase_ms)
        air.open("A1", changed(plan_.pad_words(), interval_ms=100))
        before = air.air.collisions
        air.run(1_000)
        hit += air.air.collisions > before
    assert hit >= 6


# --- row 3: slots ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", BOARDS, ids=lambda each: each.name)
@pytest.mark.parametrize("anchors", [6, 8])
def test_twelve_slots_are_refused_for_more_than_four_anchors(virtual: Make, profile: NodeProfile, anchors: int) -> None:
    air = virtual()
    uav = air.add("uav", profile)
    air.open("uav", changed(plan(anchors).uav_ranging(), slots_per_round=12))
    assert "SLOTS_PER_RR" in uav.ended[A]
    assert "INVALID_PARAMETER" in uav.ended[A]


# --- rows 4 and 5, and the rest of what boards refuse ----------------------------------------------------------------

BLINKS = BlinkPlan(session_id=C, pad_macs=(0xA001, 0xA002, 0xA003, 0xA004), uav_mac=0xD001, sts_key=b"k" * 16)
OLD_BLINKS = {"rframe_config": RframeConfig.SP3, "schedule_mode": ScheduleMode.CONTENTION, "sfd_id": 2}
LEAD, TAG = plan().uav_ranging(), BLINKS.uav_tag()


@pytest.mark.parametrize(
    ("profile", "config", "named"),
    [
        (DWM3001CDK, TAG, "RANGING_ROUND_USAGE"),
        (QM35, TAG, "RANGING_ROUND_USAGE"),
        (PICA, TAG, "RANGING_ROUND_USAGE"),
        (DWM3001CDK, changed(TAG, **OLD_BLINKS), "RANGING_ROUND_USAGE"),
        (SR150, changed(TAG, rframe_config=RframeConfig.SP3), "RFRAME_CONFIG"),
        (SR150, changed(TAG, schedule_mode=ScheduleMode.CONTENTION), "SCHEDULE_MODE"),
        (SR150, changed(TAG, sfd_id=2), "SFD_ID"),
        (DWM3001CDK, changed(LEAD, schedule_mode=ScheduleMode.CONTENTION), "SCHEDULE_MODE"),
        (DWM3001CDK, changed(LEAD, channel=6), "CHANNEL_NUMBER"),
        (SR150, changed(LEAD, channel=13), "CHANNEL_NUMBER"),
        (DWM3001CDK, changed(LEAD, preamble_code=27), "PREAMBLE_CODE_INDEX"),
        (SR150, changed(LEAD, preamble_code=27, sfd_id=0), "SFD_ID"),
        (DWM3001CDK, changed(LEAD, sfd_id=3), "SFD_ID"),
        (DWM3001CDK, changed(LEAD, rframe_config=RframeConfig.SP0), "RFRAME_CONFIG"),
        (DWM3001CDK, changed(LEAD, sts_config=StsConfig.DYNAMIC, session_key=None), "STS_CONFIG"),
        (DWM3001CDK, changed(LEAD, slot_duration_rstu=600), "SLOT_DURATION (0x08): INVALID_RANGE"),
        (DWM3001CDK, changed(LEAD, interval_ms=20), "RANGING_INTERVAL"),
        (DWM3001CDK, changed(LEAD, extra=((0x7F, b"\x01"),)), "parameter 0x7f"),
    ],
)
def test_what_a_board_cannot_do_it_refuses_by_name(
    virtual: Make, profile: NodeProfile, config: SessionConfig, named: str
) -> None:
    air = virtual()
    host = air.add("node", profile)
    air.open("node", config)
    assert named in host.ended[config.session_id]


@pytest.mark.parametrize("change", [{"channel": 6}, {"slots_per_round": 4}, {"rframe_config": RframeConfig.SP0}])
def test_pica_takes_what_no_chip_does(virtual: Make, change: dict[str, Any]) -> None:
    air = virtual()
    host = air.add("node", PICA)
    air.open("node", changed(LEAD, **change))
    assert not host.ended
    assert host.active(A)


def test_data_that_is_too_long_for_the_node_or_its_slot_is_refused(virtual: Make) -> None:
    air = virtual()
    for profile, octets, slot_rstu, wanted in (
        (DWM3001CDK, 84, 2_400, None),
        (DWM3001CDK, 85, 2_400, TransferStatus.INVALID_FORMAT),
        (SR150, 600, 2_400, None),
        (SR150, 2_031, 2_400, TransferStatus.INVALID_FORMAT),
        (SR150, 2_031, 4_800, None),
    ):
        host = air.add(f"{profile.name}/{octets}/{slot_rstu}", profile)
        air.open(host.node.name, changed(LEAD, slot_duration_rstu=slot_rstu, interval_ms=60))
        assert air.send(host.node.name, A, bytes(octets))
        refused = [status for status in host.transfers() if status != TransferStatus.OK]
        assert refused == ([] if wanted is None else [wanted])


def test_a_board_has_room_for_so_many_sessions(virtual: Make) -> None:
    air = virtual()
    host = air.add("node", DWM3001CDK)
    for number in range(6):
        air.open("node", replace(LEAD, session_id=50 + number))
    assert list(host.ended) == [55]
    assert "MAX_SESSIONS_EXCEEDED" in host.ended[55]


@pytest.mark.parametrize(
    ("profile", "range_mm", "said"),
    [
        (DWM3001CDK, -40, (Status.NEGATIVE_DISTANCE, None)),
        (PICA, -40, (Status.OK, 0)),
        (PICA, 5_019, (Status.OK, 5_010)),
        (DWM3001CDK, 5_019, (Status.OK, 5_020)),
        (DWM3001CDK, None, (Status.RANGING_RX_TIMEOUT, None)),
    ],
)
def test_distances_as_boards_tell_them(
    virtual: Make, profile: NodeProfile, range_mm: int | None, said: tuple[int, int | None]
) -> None:
    air, plan_ = virtual(), plan(1)
    air.ranges_mm[frozenset(("A1", "uav"))] = range_mm
    air.add("uav", profile)
    pad = air.add("A1", profile)
    air.open("A1", plan_.pad_ranging(0))
    air.open("uav", plan_.uav_ranging())
    air.run(200)
    records = pad.records(A)
    assert {(record.status, record.range_mm) for record in records} == {said}
    tells = profile is PICA
    assert {record.obstructed for record in records} == {False if tells else None}


# --- the new plan ----------------------------------------------------------------------------------------------------


def opened(air: VirtualAir, plan_: RangingPlan, profile: NodeProfile) -> None:
    names = PAD[: len(plan_.pad_macs)]
    blinks = plan_.timed_blinks()
    for name in (*names, "uav"):
        air.add(name, profile)
    for index, name in enumerate(names):
        air.open(name, plan_.pad_ranging(index), plan_.pad_words() if index == 0 else None)
        if blinks is not None:
            air.open(name, blinks.pad_anchor(index))
    air.open("uav", plan_.uav_ranging(), plan_.uav_words(), None if blinks is None else blinks.uav_tag())


@pytest.mark.parametrize("anchors", [4, 6, 8])
@pytest.mark.parametrize("profile", [*BOARDS, IDEAL], ids=lambda each: each.name)
def test_the_plan_ranges_and_talks_on_every_board_without_a_collision(
    virtual: Make, profile: NodeProfile, anchors: int
) -> None:
    air = virtual(stamp=lambda anchor, tag, t_s: round(t_s * 1e6))
    ability = ability_of(profile.said())
    assert ability is not None
    plan_ = plan(anchors)
    if ability.blinks == "scheduled":
        plan_ = replace(plan_, blinks=replace(BLINKS, pad_macs=plan_.pad_macs))
    opened(air, plan_, profile)
    air.run(300)
    for number in range(5):
        assert air.send("uav", A, b"from the drone %d" % number)
        assert air.send("A1", A, b"from the pad %d" % number)
        air.run(100)
    air.run(1_000)
    assert air.air.collisions == air.air.drowned == 0
    assert not [host.ended for host in air.hosts.values() if host.ended]
    for name in PAD[:anchors]:
        host = air.hosts[name]
        assert len(host.records(A)) >= 1_500 // plan_.interval_ms
        assert {record.range_mm for record in host.records(A)} == {5_000}
        assert b"".join(host.data(A)) == b"".join(b"from the drone %d" % number for number in range(5))
        stamped = [each for report in host.reports(C) for each in report.one_way]
        assert bool(stamped) is (plan_.blinks is not None)
    assert b"".join(air.hosts["uav"].data(A)) == b"".join(b"from the pad %d" % number for number in range(5))


ONE_WAY = replace(DWM3001CDK, quirks=replace(DWM3001CDK.quirks, responder_data=False))


@pytest.mark.parametrize("profile", [PICA, ONE_WAY], ids=("pica", "a board of that kind"))
def test_where_only_the_initiator_carries_data_two_sessions_share_a_block(virtual: Make, profile: NodeProfile) -> None:
    air, plan_ = virtual(), plan(words="initiator")
    opened(air, plan_, profile)
    air.run(300)
    assert air.send("uav", A, b"down")
    assert air.send("A1", B, b"up")
    assert air.send("A2", A, b"a responder's word")
    air.run(1_000)
    assert air.air.collisions == 0
    assert air.hosts["A3"].data(A) == [b"down"]
    assert air.hosts["uav"].data(B) == [b"up"]
    assert air.hosts["uav"].data(A) == []


# --- foreign sessions on the same channel and code -------------------------------------------------------------------


def longer(steps: int) -> int:
    """A session's id, the blocks of which are so many steps longer than those of ``A``."""
    return next(each for each in range(0x70, 0x90) if steps_ms(each) == steps_ms(A) + steps)


def beside(virtual: Make, *, apart_mm: int, code: int = 10, phase_ms: int = 27, steps: int = 0) -> VirtualAir:
    """A pad and a drone 5 m from each other, and the same ``apart_mm`` away, both in full swing.

    The blocks of the others are so many ``steps`` longer."""
    air = virtual()
    mine, theirs = plan(), plan(session_a_id=longer(steps), session_b_id=0x1, preamble_code=code, sts_key=b"f" * 16)
    assert theirs.interval_ms == mine.interval_ms + steps
    opened(air, mine, DWM3001CDK)
    others = tuple(f"other {name}" for name in PAD[:4])
    for name in (*others, "other uav"):
        air.add(name, DWM3001CDK)
    for one in (*PAD[:4], "uav"):
        for other in (*others, "other uav"):
            air.ranges_mm[frozenset((one, other))] = apart_mm
    air.run(phase_ms)
    for index, name in enumerate(others):
        air.open(name, theirs.pad_ranging(index))
    air.open("other uav", theirs.uav_ranging())
    air.run(3_000)
    return air


def shares(air: VirtualAir, names: tuple[str, ...], session_id: int, last: int = 80) -> float:
    records = [record for name in names for record in air.hosts[name].records(session_id)[-last:]]
    return sum(record.range_mm is not None for record in records) / len(records)


def test_the_nearer_of_two_groups_is_heard(virtual: Make) -> None:
    phases = range(0, 28, 2)
    far = [beside(virtual, apart_mm=40_000, phase_ms=ms) for ms in phases]
    assert {shares(air, PAD[:4], A) for air in far} == {1.0}
    near = [shares(beside(virtual, apart_mm=2_000, phase_ms=ms), PAD[:4], A) for ms in phases]
    assert min(near) == 0.0, "some phases lie right over it"
    other_code = beside(virtual, apart_mm=2_000, code=11, phase_ms=list(phases)[near.index(0.0)])
    assert shares(other_code, PAD[:4], A) == 1.0
    assert other_code.air.drowned == 0


def test_who_waits_on_the_air_silences_no_anchor_of_the_one_who_is_measured(virtual: Make) -> None:
    """A drone that nobody answers yet leads rounds, too. In step with them it drowns the same answers in each."""

    def least_heard(steps: int, phase_ms: int) -> float:
        """Of the anchor that is heard least, the share of 30 rounds."""
        air, mine = virtual(), plan()
        opened(air, mine, DWM3001CDK)
        air.add("waiting", DWM3001CDK)
        air.run(phase_ms)
        air.open("waiting", plan(session_a_id=longer(steps), session_b_id=0x1, sts_key=b"f" * 16).uav_ranging())
        air.run(32 * mine.interval_ms)
        return min(shares(air, (name,), A, last=30) for name in PAD[:4])

    phases = range(1, plan().interval_ms)
    assert [least_heard(0, phase_ms) for phase_ms in phases].count(0.0) > 9, "this is what the steps are for"
    assert all(least_heard(steps, phase_ms) > 0.0 for steps in (1, 2, 3) for phase_ms in phases)


def test_sessions_have_blocks_of_four_lengths() -> None:
    lengths = {plan(session_a_id=session_id).interval_ms for session_id in range(1, 100)}
    assert sorted(lengths) == list(range(min(lengths), min(lengths) + 4))


@pytest.mark.parametrize("profile", [DWM3001CDK, SR150], ids=lambda each: each.name)
@pytest.mark.parametrize("away_mm", [3_000, 40_000])
def test_a_proof_beside_a_foreign_session(virtual: Make, profile: NodeProfile, away_mm: int) -> None:
    """Farther away than the drone is from its pad, or on another preamble code, it costs nothing; else it costs rounds,
    and never the truth. Each session draws one of four codes."""
    outcomes, drowned = [], 0
    rng = random.Random(6)
    for number in range(12):
        air = virtual()
        code = PREAMBLE_CODES_OF_ALL[number % len(PREAMBLE_CODES_OF_ALL)]
        theirs = plan(session_a_id=0x77, session_b_id=0x1, sts_key=b"f" * 16, preamble_code=code)
        for name in (*PAD[:4], "uav"):
            air.ranges_mm[frozenset((name, "uav"))] = 9_000
            for other in (*PAD[:4], "uav"):
                air.ranges_mm[frozenset((name, f"other {other}"))] = away_mm
        for index, name in enumerate(PAD[:4]):
            air.add(f"other {name}", profile)
            air.open(f"other {name}", theirs.pad_ranging(index))
        air.add("other uav", profile)
        air.open("other uav", theirs.uav_ranging())
        air.run(rng.uniform(100, 127))
        duo = AirDuo(profile, air)
        duo.run(60_000)
        assert air.air.collisions == 0
        outcomes.append(None if duo.verdict is None else duo.verdict.outcome)
        drowned += air.air.drowned
    if away_mm > 9_000:
        assert (set(outcomes), drowned) == ({"verified"}, 0)
    else:
        assert drowned > 0
        assert outcomes.count("verified") >= 9
        assert "refuted" not in outcomes


@pytest.mark.parametrize("profile", [DWM3001CDK, SR150], ids=lambda each: each.name)
def test_a_second_drone_in_flight_takes_nothing_from_a_proof(virtual: Make, profile: NodeProfile) -> None:
    """It flies to and fro at 5 m/s, 30 m off, its radio open for its own session, on the same code, at every phase."""
    code = AirDuo(profile, virtual()).pad.plan.preamble_code
    theirs = plan(session_a_id=0x77, session_b_id=0x78, sts_key=b"f" * 16, preamble_code=code)
    for number in range(24):
        air = virtual()

        def reach(receiver: str, sender: str, air: VirtualAir = air) -> int | None:
            if "second" not in (receiver, sender):
                return air.range_mm(receiver, sender)
            return 30_000 + round(5_000 * abs(air.loop.time() % 4 - 2))

        air.air.reach = reach
        for name in (*PAD[:4], "uav"):
            air.ranges_mm[frozenset((name, "uav"))] = 9_000
        second = air.add("second", profile)
        air.open("second", theirs.uav_ranging())
        air.run(100 + number * 25 / 24)  # all slots of a block, and frames of 0.2 ms all over a slot
        before = air.air.rounds
        duo = AirDuo(profile, air)
        duo.run(60_000)
        assert duo.verdict is not None
        assert duo.verdict.outcome == "verified"
        assert (air.air.collisions, air.air.drowned) == (0, 0)
        assert air.air.rounds - before > 2 * duo.verdict.rounds, "both were on the air"
        assert {record.range_mm for record in second.records(theirs.session_a_id)} == {None}, "nobody answers it"
