"""What a pad can do now: each way in which it can prove nothing is found, named, and found to be over."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest
from kit.agents import open_ledger

from wonderland.proof_contract import RefusedError
from wonderland.uwb.agreed import ASSUMED
from wonderland_edge_agent.ability import Now, goes_on_without, not_known, why_not
from wonderland_edge_agent.metrics import exposition
from wonderland_edge_agent.radios import AnchorState
from wonderland_fira_uci.uci.capabilities import ScheduleModes
from wonderland_simulator.uci_node import DWM3001CDK

UP = tuple(AnchorState(name, "up", "", None) for name in ("A1", "A2", "A3", "A4"))


def down(*names):
    return tuple(AnchorState(s.anchor_id, "down", "unplugged", None) if s.anchor_id in names else s for s in UP)


def faulty(*names):
    """These answer, and measure nothing while others do."""
    return tuple(
        AnchorState(s.anchor_id, "silent", "measures nothing", None, faulty=True) if s.anchor_id in names else s
        for s in UP
    )


def mute(*names):
    """These range, and accept no data."""
    return tuple(
        AnchorState(s.anchor_id, "silent", "accepts no data", None, speaks=False) if s.anchor_id in names else s
        for s in UP
    )


def unproven(*names):
    """No other anchor hears these, and no drone has come."""
    return tuple(AnchorState(s.anchor_id, "up", "", None, unproven=s.anchor_id in names) for s in UP)


def unseen(*names):
    """Nobody has looked yet whether these range."""
    return tuple(AnchorState(s.anchor_id, "up", "", None, unseen=s.anchor_id in names) for s in UP)


def able(*names, **changes):
    """These nodes say what a DWM3001CDK does, but for the changes."""
    found = replace(DWM3001CDK.said(), **changes)
    return tuple(AnchorState(s.anchor_id, "up", "", None, found if s.anchor_id in names else None) for s in UP)


ALL = ("A1", "A2", "A3", "A4")
FIFTH = AnchorState("A5", "up", "", None)


class Record:
    """As much of a pad's record as is looked at."""

    class Anchor:
        def __init__(self, anchor_id):
            self.anchor_id = anchor_id

    class Commissioning:
        def __init__(self, names, channels):
            self.anchors = [Record.Anchor(name) for name in names]
            self.nodes = replace(ASSUMED, channels=channels)

    def __init__(self, status="commissioned", names=("A1", "A2", "A3", "A4"), channels=(5, 9)):
        self.status = status
        self.commissioning = Record.Commissioning(names, channels) if names else None


WELL = {"ledger_trouble": "", "pad": Record(), "anchors": UP, "moved": "", "spool_trouble": "", "prekeys": 20}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({}, None),
        ({"anchors": None}, None),
        ({"prekeys": None}, None),
        ({"anchors": down("A3")}, "3 of 4 anchors can range, 4 are needed: A3 (unplugged)"),
        ({"anchors": faulty("A3")}, "3 of 4 anchors can range, 4 are needed: A3 (measures nothing)"),
        ({"anchors": tuple(AnchorState(s.anchor_id, "silent", "", None) for s in UP)}, None),
        ({"anchors": down("A3", "A4")}, "2 of 4 anchors can range, 4 are needed: A3 (unplugged), A4 (unplugged)"),
        ({"anchors": down("A1", "A2", "A3", "A4")}, "0 of 4 anchors can range"),
        ({"anchors": ()}, "0 of 4 anchors can range, 4 are needed: A1 (no port configured)"),
        ({"anchors": UP[1:]}, "A1 (no port configured)"),
        ({"pad": Record(names=("A1", "A2", "A3"))}, None),
        ({"pad": Record(names=("A1", "A2", "A4")), "anchors": down("A4")}, "2 of 3 anchors can range, 3 are needed"),
        ({"pad": Record(names=("A4", "A3", "A2", "A1", "A5")), "anchors": (*UP, FIFTH)}, None),
        ({"pad": Record(names=("A4", "A3", "A2", "A1", "A5")), "anchors": (*down("A1"), FIFTH)}, None),
        (
            {"pad": Record(names=("A4", "A3", "A2", "A1", "A5")), "anchors": down("A1")},
            "3 of 5 anchors can range, 4 are needed: A1 (unplugged), A5 (no port configured)",
        ),
        ({"anchors": unproven(*ALL)}, None),
        ({"anchors": mute("A1", "A2", "A3")}, None),
        ({"anchors": mute(*ALL)}, "no anchor can speak to the drone: A1 (accepts no data), A2 (accepts no data), A3"),
        ({"anchors": able(*ALL)}, None),
        (
            {"anchors": able(*ALL, schedule_modes=ScheduleModes.CONTENTION)},
            "0 of 4 anchors can range, 4 are needed: A1 (cannot do time-scheduled ranging), A2 (cannot do time-",
        ),
        ({"anchors": able("A2", channels=(5,))}, "3 of 4 anchors can range, 4 are needed: A2 (cannot do channel 9)"),
        ({"anchors": able(*ALL, channels=(5,)), "pad": Record(channels=(5,))}, None),
        ({"pad": None}, "has not said yet"),
        ({"pad": Record("registered", ())}, "not commissioned"),
        ({"pad": Record("retired")}, "retired"),
        ({"ledger_trouble": "the ledger is away: x"}, "the ledger is away"),
        ({"moved": "anchor A1 stands elsewhere"}, "A1 stands elsewhere"),
        ({"anchors": unseen(*ALL)}, None),
        ({"anchors": unseen(*ALL), "looks": True}, "not known yet: a roll call has still to show whether the anchors"),
        ({"anchors": unseen("A3"), "looks": True}, "(A3)"),
        ({"anchors": (*unseen("A3"), FIFTH), "looks": True, "pad": Record(names=(*ALL, "A5"))}, None),
        ({"anchors": down("A3"), "looks": True}, "3 of 4 anchors can range, 4 are needed: A3 (unplugged)"),
        ({"spool_trouble": "the disk is full"}, "disk is full"),
        ({"prekeys": 0}, "no prekey"),
    ],
)
def test_each_reason(change, reason):
    found = why_not(Now(**(WELL | change)))
    if reason is None:
        assert found == []
    else:
        assert len(found) == 1
        assert reason in found[0]


@pytest.mark.parametrize("why", [down, faulty])
def test_a_pad_of_five_goes_on_with_four_and_says_so(why):
    record = Record(names=("A1", "A2", "A3", "A4", "A5"))
    (word,) = goes_on_without(Now(**(WELL | {"pad": record, "anchors": (*why("A3"), FIFTH)})))
    assert word.startswith("A3 (")
    assert goes_on_without(Now(**(WELL | {"pad": record, "anchors": (*UP, FIFTH)}))) == []
    assert goes_on_without(Now(**(WELL | {"pad": record, "anchors": why("A3")}))) == []


def test_who_cannot_speak_is_named_where_others_do():
    assert goes_on_without(Now(**(WELL | {"anchors": mute("A2")}))) == ["the voice of A2 (accepts no data)"]


def test_whether_anchors_range_that_nothing_has_shown_is_not_known():
    (word,) = not_known(Now(**(WELL | {"anchors": unproven(*ALL)})))
    assert word.endswith("not known until a drone has been ranged (A1, A2, A3, A4)")
    assert not_known(Now(**WELL)) == []
    assert not_known(Now(**(WELL | {"anchors": None}))) == []
    assert not_known(Now(**(WELL | {"anchors": (*unproven("A3"), FIFTH), "pad": Record(names=(*ALL, "A5"))}))) == []


def test_several_reasons_are_all_said():
    found = why_not(Now(**(WELL | {"anchors": down("A1", "A2"), "ledger_trouble": "away", "prekeys": 0})))
    assert len(found) == 3


async def until(condition):
    async with asyncio.timeout(15):
        while not condition():
            await asyncio.sleep(0.05)


def says(pad, word):
    """The same in the status and in the metric."""
    status = pad.status()
    able = f'accepts_sessions{{pad_id="{pad.pad_id}"}} 1'.encode() in exposition(status)
    assert able == status["accepts_sessions"] == (not status["cannot_prove"])
    return any(word in reason for reason in status["cannot_prove"]) if word else able


async def test_unplugged_anchors_and_a_lost_ledger_are_noticed_and_forgotten(world, monkeypatch):
    monkeypatch.setattr("wonderland_edge_agent.agent.CARE_S", 0.2)
    async with world.pad() as pad:
        await until(lambda: says(pad, ""))
        ports = [port for name, port in world.ports.items() if name != "uav"]
        for port in ports:
            port.unplug()
        await until(lambda: says(pad, f"0 of {len(ports)} anchors can range"))
        for port in ports:
            port.plug()
        await until(lambda: says(pad, ""))
        address = world.connection.gateway.address
        await world.ledger.stop()
        await until(lambda: says(pad, "the ledger is away"))
        world.ledger = open_ledger(world.directory, listen=address)
        await world.ledger.start()
        await until(lambda: says(pad, ""))


async def test_a_pad_that_the_ledger_does_not_know_is_not_working(world, monkeypatch):
    monkeypatch.setattr("wonderland_edge_agent.agent.CARE_S", 0.2)
    async with world.pad() as pad:
        await until(lambda: says(pad, ""))

        async def unknown(_pad_id):
            raise RefusedError(404, "PAD_UNKNOWN", "no pad pad-1")

        monkeypatch.setattr(pad._ledger, "read_pad", unknown)
        await until(lambda: says(pad, "PAD_UNKNOWN"))
