"""The small parts that the agents are made of, each alone."""

from __future__ import annotations

import asyncio
import contextlib
import json
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.clock import SteadyClock
from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs.records.pads import Prekey
from wonderland.proofs.records.sessions import MAX_CLAIMS, AnchorRanges, Claim, RangeTable
from wonderland.uwb.link.errors import PayloadError
from wonderland.uwb.link.proof_payloads import ClaimBatch, RangesPart
from wonderland_edge_agent.prekeys import ORPHAN_AGE_MS, PrekeyKeeper
from wonderland_edge_agent.reconcile import UNKNOWN_MS, Reconciler
from wonderland_edge_agent.session.evidence import GatheredEvidence
from wonderland_edge_agent.session.gather import Round, RoundGatherer
from wonderland_uav_agent.position import AutopilotPosition, PositionError, TrackPosition
from wonderland_uav_agent.session.crosscheck import OwnRanges

NAMES = ("A1", "A2", "A3", "A4")
NOW_MS = 1_800_000_000_000


def claim(t_ms=NOW_MS, **more):
    values = {
        "lat_e7": 604_518_000,
        "lon_e7": 222_666_000,
        "height_mm": 30_000,
        "accuracy_mm": 500,
        "height_accuracy_mm": 800,
        "t_ms": t_ms,
    }
    return Claim(**(values | more))


# --- rounds -------------------------------------------------------------------------------------------------------


def test_four_reports_within_the_interval_are_one_round():
    gatherer = RoundGatherer(NAMES, 50)
    assert gatherer.add("A2", 1_000, 5_000) == []
    assert gatherer.add("A1", 1_003, 5_100) == []
    assert gatherer.add("A4", 1_009, None) == []
    assert gatherer.add("A3", 1_020, 5_204, nlos=True) == [
        Round(1_000, (5_100, 5_000, 5_200, -1), (False, False, True, False))
    ]


def test_a_missing_report_closes_the_round_by_time_or_by_the_next_one():
    gatherer = RoundGatherer(NAMES, 50)
    gatherer.add("A1", 1_000, 5_000)
    assert gatherer.expire(1_034) == []
    assert [entry.t_ms for entry in gatherer.expire(1_035)] == [1_000]
    gatherer.add("A1", 1_050, 5_010)
    assert [entry.range_mm for entry in gatherer.add("A1", 1_100, 5_020)] == [(5_010, -1, -1, -1)]


def test_rounds_without_a_range_and_strange_anchors_give_nothing():
    gatherer = RoundGatherer(NAMES, 50)
    assert gatherer.add("B7", 1_000, 5_000) == []
    for name in NAMES:
        assert gatherer.add(name, 1_000, None) == []


@settings(max_examples=60, deadline=None)
@given(
    reports=st.lists(
        st.tuples(st.sampled_from(NAMES), st.integers(0, 120), st.one_of(st.none(), st.integers(0, 99_990))),
        max_size=80,
    )
)
def test_whatever_order_reports_come_in_times_rise_and_nothing_is_doubled(reports):
    gatherer = RoundGatherer(NAMES, 50)
    now_ms, rounds = NOW_MS, []
    for name, wait_ms, range_mm in reports:
        now_ms += wait_ms - 20
        rounds += gatherer.add(name, now_ms, range_mm)
    rounds += gatherer.expire(now_ms + 10_000)
    assert [entry.t_ms for entry in rounds] == sorted(entry.t_ms for entry in rounds)
    told = sum(range_mm is not None for _, _, range_mm in reports)
    assert sum(entry.count for entry in rounds) <= told
    assert all(value % 10 == 0 or value == -1 for entry in rounds for value in entry.range_mm)


def test_evidence_keeps_columns_and_refuses_gaps_in_claims():
    gathered = GatheredEvidence(NAMES)
    for index in range(3):
        gathered.add_round(Round(1_000 + 50 * index, (10, 20, -1, 40 + index), (False, index == 1, False, False)))
    table = gathered.table(1)
    assert table.t_ms == (1_050, 1_100)
    assert table.anchors[1].nlos == (0,)
    assert gathered.latest() == {"A1": 10, "A2": 20, "A4": 42}
    assert gathered.add_claims(ClaimBatch(0, (claim(), claim())))
    assert not gathered.add_claims(ClaimBatch(1, (claim(),)))
    assert not gathered.add_claims(ClaimBatch(3, (claim(),)))
    gathered.frozen = True
    assert not gathered.add_round(Round(2_000, (1, 1, 1, 1), (False,) * 4))
    assert gathered.reach("poll", 5)
    assert not gathered.reach("poll", 9)


# --- payloads -----------------------------------------------------------------------------------------------------

claims = st.builds(
    claim,
    t_ms=st.integers(0, 253_402_300_799_999),
    lat_e7=st.integers(-900_000_000, 900_000_000),
    lon_e7=st.integers(-1_800_000_000, 1_800_000_000),
    height_mm=st.integers(-1_000_000, 50_000_000),
    accuracy_mm=st.integers(1, 10_000_000),
    height_accuracy_mm=st.integers(1, 10_000_000),
)


@settings(max_examples=80, deadline=None)
@given(first=st.integers(0, 100), batch=st.lists(claims, min_size=1, max_size=20))
def test_claims_survive_the_radio(first, batch):
    made = ClaimBatch(first, tuple(batch))
    assert ClaimBatch.decode(made.encode()) == made


@settings(max_examples=80, deadline=None)
@given(
    first=st.integers(0, 100),
    final=st.booleans(),
    rows=st.lists(
        st.tuples(st.integers(0, 60_000), *[st.integers(-1, 6_000).map(lambda v: -1 if v < 0 else v * 10)] * 4),
        max_size=40,
    ),
)
def test_ranges_survive_the_radio(first, final, rows):
    times, now_ms = [], NOW_MS
    for gap, *_ in rows:
        now_ms += gap
        times.append(now_ms)
    table = RangeTable(
        t_ms=tuple(times),
        anchors=tuple(
            AnchorRanges(anchor_id=name, range_mm=tuple(row[1 + index] for row in rows))
            for index, name in enumerate(NAMES)
        ),
    )
    part = RangesPart(first, table, final)
    assert RangesPart.decode(part.encode(), NAMES) == part


@settings(max_examples=200, deadline=None)
@given(data=st.binary(max_size=200))
def test_garbage_is_a_payload_error_and_nothing_else(data):
    for decode in (ClaimBatch.decode, lambda octets: RangesPart.decode(octets, NAMES)):
        with contextlib.suppress(PayloadError):
            decode(data)


def test_more_than_a_session_holds_is_refused():
    with pytest.raises(PayloadError, match="session"):
        ClaimBatch(MAX_CLAIMS, (claim(),)).encode()
    with pytest.raises(PayloadError):
        ClaimBatch(0, (claim(lat_e7=1 << 40),)).encode()


# --- the drone's own check ----------------------------------------------------------------------------------------


def told(rows, *, start_ms=NOW_MS):
    return RangeTable(
        t_ms=tuple(start_ms + 50 * index for index in range(len(rows))),
        anchors=tuple(
            AnchorRanges(anchor_id=name, range_mm=tuple(row[index] for row in rows)) for index, name in enumerate(NAMES)
        ),
    )


MACS = {name: 0xA000 + index for index, name in enumerate(NAMES)}


def measured(rows, *, offset_ms=0, error_mm=0):
    own = OwnRanges()
    for index, row in enumerate(rows):
        for name, value in zip(NAMES, row, strict=True):
            own.add(MACS[name], NOW_MS + offset_ms + 50 * index, value + error_mm)
    return own


FLYING = [[5_000 + 150 * index + 700 * anchor for anchor in range(4)] for index in range(20)]
"""3 m/s away from the pad."""


@pytest.mark.parametrize("offset_ms", [-4_000, 0, 3_000])
@pytest.mark.parametrize("latency_ms", [40, 300, 1_200])
def test_equal_ranges_agree_whatever_the_clocks_say(offset_ms, latency_ms):
    table = told(FLYING)
    comparison = measured(FLYING, offset_ms=offset_ms).compare(table, MACS, table.t_ms[-1] + offset_ms + latency_ms)
    assert comparison.refusal == ""
    assert comparison.median_mm <= 160
    assert comparison.pairs >= 60


def test_other_ranges_disagree():
    table = told(FLYING)
    comparison = measured(FLYING, error_mm=9_000).compare(table, MACS, table.t_ms[-1] + 100)
    assert comparison.refusal == "ranges_disagree"


def test_without_own_ranges_there_is_nothing_to_sign():
    table = told(FLYING)
    assert OwnRanges().compare(table, MACS, table.t_ms[-1]).refusal == "no_own_ranges"
    assert measured(FLYING[:2]).compare(table, MACS, table.t_ms[-1] + 100).refusal == "no_own_ranges"
    assert measured(FLYING).compare(told([]), MACS, NOW_MS).refusal == "no_ranges_told"


# --- prekeys ------------------------------------------------------------------------------------------------------


class Vault:
    def __init__(self):
        self.kept = {}

    async def put_secrets(self, secrets):
        assert not set(secrets) & set(self.kept)
        self.kept.update(secrets)

    async def take_secret(self, name):
        return self.kept.pop(name, None)

    async def secret_names(self):
        return list(self.kept)


class PrekeyLedger:
    def __init__(self, vault):
        self.vault = vault
        self.offered = {}
        self.fails = None

    async def publish_prekeys(self, pad_id, prekeys):
        # The private halves are safe before anybody can name the public ones.
        assert all(f"prekey/{entry.prekey_id}" in self.vault.kept for entry in prekeys)
        if self.fails:
            raise self.fails
        self.offered.update({entry.prekey_id: entry for entry in prekeys})
        return Committed("t", 1)

    async def list_prekeys(self, pad_id, limit=10):
        return tuple(
            Prekey(
                pad_id=pad_id,
                prekey_id=entry.prekey_id,
                public_key=entry.public_key,
                msp_id="PadMSP",
                certificate_sha256="0" * 64,
                published_ms=NOW_MS,
            )
            for entry in list(self.offered.values())[:limit]
        )


@pytest.fixture
def keeper():
    vault = Vault()
    ledger = PrekeyLedger(vault)
    made = PrekeyKeeper("pad-1", vault, ledger, lambda: NOW_MS, 8)
    made.vault, made.ledger = vault, ledger
    return made


async def test_prekeys_are_published_when_half_are_used_and_taken_once(keeper):
    assert keeper.available is None  # the ledger has not said it yet
    await keeper.ensure()
    assert keeper.available == len(keeper.ledger.offered) == 8
    names = list(keeper.ledger.offered)
    for name in names[:4]:
        del keeper.ledger.offered[name]
        assert await keeper.take_key(name) is not None
        assert await keeper.take_key(name) is None
    assert keeper.low
    await keeper.ensure()
    assert keeper.available == 8


async def test_a_refused_publication_leaves_no_keys_behind_and_a_lost_answer_keeps_them(keeper):
    keeper.ledger.fails = RefusedError(403, "NOT_YOURS", "no")
    with pytest.raises(RefusedError):
        await keeper.ensure()
    assert keeper.vault.kept == {}
    keeper.ledger.fails = AwayError("lost")
    with pytest.raises(AwayError):
        await keeper.ensure()
    assert len(keeper.vault.kept) == 8


async def test_keys_that_nobody_can_name_any_more_are_dropped_after_a_day(keeper):
    old, young = f"{NOW_MS - ORPHAN_AGE_MS - 1:012x}-aa", f"{NOW_MS - 1000:012x}-bb"
    keeper.vault.kept = {f"prekey/{old}": b"1" * 32, f"prekey/{young}": b"2" * 32, "prekey/odd": b"3", "other": b"4"}
    await keeper.ensure()
    assert f"prekey/{old}" not in keeper.vault.kept
    assert {f"prekey/{young}", "prekey/odd", "other"} <= set(keeper.vault.kept)


# --- ends of sessions ---------------------------------------------------------------------------------------------


class Ends:
    def __init__(self):
        self.list = []

    def ended(self, session_id, state, end, t_ms, *, tx_id="", steps=None):
        self.list.append((session_id, state, end))


class EndLedger:
    def __init__(self, session, verdict=None):
        self.session, self.verdict = session, verdict
        self.away = False
        self.cancelled = []

    async def read_session(self, session_id):
        if self.away:
            raise AwayError("gone")
        if self.session is None:
            raise RefusedError(404, "SESSION_UNKNOWN", "no such session")
        return self.session

    async def read_verdict(self, session_id):
        return self.verdict

    async def cancel(self, session_id, reason, note=""):
        self.cancelled.append(reason)
        self.session = replace(self.session, state="cancelled", end=reason, ended_by="pad")
        return self.session, Committed("c" * 64, 3)


@pytest.fixture
def session_of(make_duo):
    return make_duo().session


async def looked(ledger, *, now_ms=NOW_MS, reason="agent_restart"):
    ends = Ends()
    reconciler = Reconciler(ledger, ends, lambda: now_ms)
    reconciler.add_interrupted({"a" * 64: {"reason": reason}})
    await reconciler.look_at_sessions()
    return ends.list, reconciler


async def test_a_session_left_open_is_cancelled_and_recorded(session_of):
    ledger = EndLedger(session_of)
    ends, reconciler = await looked(ledger)
    assert ledger.cancelled == ["agent_restart"]
    assert ends == [("a" * 64, "cancelled", "agent_restart")]
    assert reconciler.waiting == 0


async def test_what_ended_meanwhile_is_only_recorded(session_of):
    for state, end in (("completed", "done"), ("cancelled", "no_poll")):
        ledger = EndLedger(replace(session_of, state=state, end=end))
        ends, _ = await looked(ledger)
        assert ends == [("a" * 64, state, end)]
        assert ledger.cancelled == []


async def test_a_standing_permission_is_left_until_it_lapses(make_duo):
    duo = make_duo()
    duo.run()
    decided = replace(duo.session, state="decided")
    ledger = EndLedger(decided, duo.verdict)
    ends, reconciler = await looked(ledger, now_ms=duo.session.expires_ms)
    assert (ends, reconciler.waiting, ledger.cancelled) == ([], 1, [])
    ends, _ = await looked(ledger, now_ms=duo.session.expires_ms + 60_000)
    assert ends == [("a" * 64, "cancelled", "permission_expired")]


async def test_a_refused_session_needs_nothing_more(make_duo, make_flight):
    duo = make_duo(flight=make_flight(truth=(20_000.0, 0.0, 5_000.0)))
    duo.run()
    ledger = EndLedger(replace(duo.session, state="decided"), duo.verdict)
    ends, _ = await looked(ledger)
    assert ends == [("a" * 64, "decided", "refused")]


async def test_an_absent_ledger_is_waited_for_and_an_unknown_session_forgotten(session_of):
    ledger = EndLedger(session_of)
    ledger.away = True
    ends, reconciler = await looked(ledger)
    assert (ends, reconciler.waiting) == ([], 1)
    ledger.away = False
    await reconciler.look_at_sessions()
    assert reconciler.waiting == 0


async def test_a_session_is_unknown_to_a_ledger_only_after_a_while(session_of):
    """The peer that is asked may be behind the one that told of the session."""
    ledger, ends, now_ms = EndLedger(None), Ends(), [NOW_MS]
    reconciler = Reconciler(ledger, ends, lambda: now_ms[0])
    reconciler.add("a" * 64, "agent_restart")
    await reconciler.look_at_sessions()
    ledger.away = True
    now_ms[0] += UNKNOWN_MS - 1
    await reconciler.look_at_sessions()
    ledger.away = False
    await reconciler.look_at_sessions()
    assert (ends.list, reconciler.waiting) == ([], 1)
    now_ms[0] += 1
    await reconciler.look_at_sessions()
    assert ends.list == [("a" * 64, "cancelled", "unknown_to_ledger")]
    assert reconciler.waiting == 0


async def test_a_session_that_appears_after_all_is_ended(session_of):
    ledger, ends = EndLedger(None), Ends()
    reconciler = Reconciler(ledger, ends, lambda: NOW_MS)
    reconciler.add("a" * 64, "agent_restart")
    await reconciler.look_at_sessions()
    ledger.session = session_of
    await reconciler.look_at_sessions()
    assert ends.list == [("a" * 64, "cancelled", "agent_restart")]


# --- positions ----------------------------------------------------------------------------------------------------


async def test_the_autopilots_position_is_fresh_or_none():
    now = [NOW_MS]
    async with AutopilotPosition(("127.0.0.1", 0), lambda: now[0]) as source:
        assert source.claim(now[0]) is None
        with pytest.raises(PositionError, match="no position arrived"):
            await source.wait(0.01)
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=source.address
        )
        transport.sendto(claim().encode())
        await source.wait(2)
        assert source.claim(now[0] + 900) == claim()
        assert source.claim(now[0] + 1_100) is None
        transport.sendto(b"\xff" * 10)
        transport.sendto(json.dumps({"lat_e7": 1.5}).encode())
        while source.datagrams < 3:
            await asyncio.sleep(0.005)
        assert source.bad == 2
        assert source.claim(now[0]) == claim()
        transport.close()
        with pytest.raises(PositionError, match="cannot listen"):
            async with AutopilotPosition(source.address, lambda: now[0]):
                pass


def test_a_track_is_replayed_with_straight_lines(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text(
        "t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n"
        "500,604518000,222666000,30000,500,800\n1500,604519000,222666000,31000,700,800\n"
    )
    track = TrackPosition.load(path, NOW_MS)
    assert track.claim(NOW_MS - 1) is None
    assert track.claim(NOW_MS + 500) == claim(NOW_MS + 500, lat_e7=604_518_500, height_mm=30_500, accuracy_mm=600)
    assert track.claim(NOW_MS + 9_000).lat_e7 == 604_519_000
    assert track.duration_ms == 1_000


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no rows"),
        ("t_ms,lat_e7\n1,2\n", "lon_e7"),
        ("t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n1,x,2,3,4,5\n", "line 2"),
        ("t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n1,9999999999,2,3,4,5\n", "lat_e7"),
        ("t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n9,1,2,3,4,5\n8,1,2,3,4,5\n", "rise"),
    ],
)
def test_a_track_that_is_none_is_refused_by_name(tmp_path, text, complaint):
    path = tmp_path / "track.csv"
    path.write_text(text)
    with pytest.raises(PositionError, match=complaint):
        TrackPosition.load(path, NOW_MS)
    with pytest.raises(PositionError, match="cannot be read"):
        TrackPosition.load(tmp_path / "none.csv", NOW_MS)


# --- time ---------------------------------------------------------------------------------------------------------


def test_a_step_of_the_system_clock_reaches_the_agents_only_between_sessions():
    wall, monotonic = [1_000_000_000_000], [5_000_000]
    clock = SteadyClock(lambda: wall[0], lambda: monotonic[0])
    assert clock() == 1_000_000
    wall[0] -= 60_000_000_000
    monotonic[0] += 250_000_000
    assert clock() == 1_000_250
    assert clock.resync() == -60_250
    assert clock() == 940_000
