"""The datagrams between a drone with a tag and its pad: what is taken, and everything that is not."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.radios import RadiosError
from wonderland_edge_agent.radios.reported import ReportedRadios
from wonderland_edge_agent.session.events import AnchorRange, DataHeard
from wonderland_fira_uci.dwm1001 import Dwm1001DecodeError, Dwm1001EncodeError, Dwm1001Error
from wonderland_fira_uci.dwm1001.carrier import MAX_BODY_OCTETS, Carrier, Hello, Ranges, Words
from wonderland_fira_uci.errors import NodeError

KEY = bytes(range(16))
PLAN = RangingPlan(session_a_id=7, session_b_id=8, pad_macs=(0xA001, 0xA002, 0xA003), uav_mac=0xD001, sts_key=KEY)
rows = st.lists(st.tuples(st.integers(0, 0xFFFF), st.integers(1, 1_000_000)), max_size=15, unique_by=lambda row: row[0])


def pair() -> tuple[Carrier, Carrier]:
    return Carrier(KEY, 7, is_pad=True), Carrier(KEY, 7, is_pad=False)


@settings(max_examples=100, deadline=None)
@given(rows, st.binary(min_size=1, max_size=MAX_BODY_OCTETS))
def test_there_and_back(table, frame):
    pad, uav = pair()
    assert pad.open(uav.ranges(table)) == Ranges(tuple(table))
    assert pad.open(uav.words(frame)) == Words(frame)
    assert uav.open(pad.words(frame)) == Words(frame)
    assert pad.open(uav.hello()) == Hello()


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_one_changed_octet_is_refused(data):
    pad, uav = pair()
    datagram = bytearray(uav.ranges([(0xA001, 5_000)]))
    index = data.draw(st.integers(0, len(datagram) - 1))
    datagram[index] ^= data.draw(st.integers(1, 255))
    with pytest.raises(Dwm1001DecodeError):
        pad.open(bytes(datagram))


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=400))
def test_any_octets_are_refused_in_words(octets):
    with pytest.raises(Dwm1001Error, match="datagram"):
        pair()[0].open(octets)


def test_repeated_reflected_and_foreign_datagrams_are_refused():
    pad, uav = pair()
    first, second = uav.hello(), uav.hello()
    pad.open(second)
    for datagram, why in (
        (second, "heard before"),
        (first, "overtaken"),
        (pad.words(b"x"), "tag is wrong"),
        (Carrier(KEY, 6, is_pad=False).hello(), "another session"),
        (Carrier(bytes(16), 7, is_pad=False).hello(), "tag is wrong"),
    ):
        with pytest.raises(Dwm1001DecodeError, match=why):
            pad.open(datagram)


def test_what_does_not_fit_is_not_sent():
    _, uav = pair()
    for table in ([(1, 0)], [(1, 1_000_001)], [(1 << 16, 5)], [(n, 5) for n in range(16)]):
        with pytest.raises(Dwm1001EncodeError):
            uav.ranges(table)
    with pytest.raises(Dwm1001EncodeError):
        uav.words(bytes(MAX_BODY_OCTETS + 1))


async def test_a_pad_hears_its_drone_and_nobody_else():
    heard: list[object] = []
    now_ms = 1_000
    async with ReportedRadios(("127.0.0.1", 0), lambda: now_ms) as radios:
        with pytest.raises(NodeError):
            await radios.send(b"x")
        with pytest.raises(RadiosError, match="2 anchors"):
            await radios.open_session(PLAN, ["A1", "A2"], heard.append)
        await radios.open_session(PLAN, ["A1", "A2", "A3"], heard.append)
        with pytest.raises(NodeError, match="not been heard"):
            await radios.send(b"x")
        uav = Carrier(KEY, 7, is_pad=False)
        forged = Carrier(bytes(16), 7, is_pad=False)
        there = ("127.0.0.1", 9)
        for datagram in (b"", b"\0" * 2_000, forged.hello()):
            radios.datagram_received(datagram, ("127.0.0.1", 11))
        radios.datagram_received(uav.ranges([(0xA001, 5_000), (0xBEEF, 1_000), (0xA003, 6_000)]), there)
        radios.datagram_received(uav.words(b"frame"), there)
        assert heard == [AnchorRange("A1", 1_000, 5_000), AnchorRange("A3", 1_000, 6_000), DataHeard(b"frame")]
        assert radios.datagrams_bad == 3
        assert [state.state for state in radios.states()] == ["up", "silent", "up"]
        now_ms = 2_100
        assert {state.state for state in radios.states()} == {"silent"}
        await radios.send(b"answer")
        await radios.close_session()
        radios.datagram_received(uav.hello(), there)
        assert len(heard) == 3
        await asyncio.sleep(0)
    assert (radios.measured_by, radios.sts) == ("uav", "static")
