"""The spool's synchronous core: numbers without gaps, evidence that stays, markers that say what was dropped."""

from __future__ import annotations

import json
import sqlite3
import stat
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from wonderland.telemetry import SpoolHealth
from wonderland_edge_agent.spool import Entry, SpoolCorruptError, SpoolError, SpoolFull, SpoolStore, StoredRecord

T0 = 1_760_000_400_000
QUOTA = 256 * 1024


def open_store(directory: Path, *, owner: str = "pad-1", quota: int = QUOTA) -> SpoolStore:
    return SpoolStore(directory / "spool.db", owner=owner, quota_bytes=quota, reserve_bytes=0)


def telemetry(size: int = 10) -> Entry:
    return Entry("track", T0, b'"' + b"t" * (size - 2) + b'"', evidence=False)


def evidence(size: int = 10) -> Entry:
    return Entry("step", T0, b'"' + b"e" * (size - 2) + b'"', evidence=True)


def everything(store: SpoolStore) -> list[StoredRecord]:
    return store.pending(0, 10**6, 10**9)


def span(record: StoredRecord) -> range:
    """The numbers that a record accounts for."""
    if record.kind != "dropped":
        return range(record.seq, record.seq + 1)
    body = json.loads(record.body)
    assert body["to_seq"] == record.seq
    return range(body["from_seq"], record.seq + 1)


def assert_gapless(store: SpoolStore) -> None:
    accounted = [seq for record in everything(store) for seq in span(record)]
    status = store.status
    assert accounted == list(range(status.acknowledged + 1, status.last_seq + 1))


def test_records_come_back_in_order_and_survive_a_restart(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    assert store.write([telemetry(), evidence()]) == [1, 2]
    assert store.write([evidence(20)]) == [3]
    spool = store.status.spool
    store.close()
    store = open_store(tmp_path)
    assert [(record.seq, record.kind, len(record.body)) for record in everything(store)] == [
        (1, "track", 10),
        (2, "step", 10),
        (3, "step", 20),
    ]
    assert store.status.spool == spool
    assert store.status.records == 3
    assert store.status.bytes == 3 * 64 + 40
    assert store.status.evidence_bytes == 2 * 64 + 30
    assert store.status.health() == SpoolHealth(records=3, bytes=232, dropped=0)
    store.close()


def test_numbers_are_never_used_again(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence()] * 5)
    store.acknowledge(5)
    store.close()
    store = open_store(tmp_path)
    assert store.write([evidence()]) == [6]
    assert store.status.acknowledged == 5
    store.close()


def test_pending_keeps_both_limits_but_gives_at_least_one(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence(1000)] * 10)
    assert [record.seq for record in store.pending(0, 3, 10**6)] == [1, 2, 3]
    assert [record.seq for record in store.pending(2, 10, 2200)] == [3, 4]
    assert [record.seq for record in store.pending(9, 10, 1)] == [10]
    assert store.pending(10, 10, 10**6) == []
    store.close()


def test_acknowledging_what_was_never_given_is_refused(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence()])
    with pytest.raises(SpoolError, match="the last record is 1"):
        store.acknowledge(2)
    store.acknowledge(1)
    store.acknowledge(0)
    assert store.status.acknowledged == 1
    store.close()


def test_telemetry_gives_way_and_a_marker_says_so(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([telemetry(900) for _ in range(100)] + [evidence()] + [telemetry(900) for _ in range(100)])
    assert store.status.dropped == 0
    store.write([evidence(100_000)])
    records = everything(store)
    assert records[0].kind == "dropped"
    assert span(records[0]).start == 1
    assert [record.seq for record in records if record.kind == "step"] == [101, 202]
    assert store.status.dropped == sum(len(span(record)) for record in records if record.kind == "dropped")
    assert store.status.bytes <= QUOTA
    assert_gapless(store)
    store.close()


def test_markers_join_as_more_is_dropped(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    for _ in range(2_000):
        store.write([telemetry(900)])
    markers = [record for record in everything(store) if record.kind == "dropped"]
    assert len(markers) == 1
    assert_gapless(store)
    store.close()


def test_evidence_alone_fills_the_quota(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    stored = 0
    while not isinstance(store.write([evidence(10_000)])[0], SpoolFull):
        stored += 1
    assert stored == QUOTA // 10_064
    assert store.status.reason.startswith("unsent evidence fills the spool")
    (refused, taken) = store.write([evidence(10_000), telemetry()])
    assert isinstance(refused, SpoolFull)
    assert "restore the connection" in str(refused)
    assert taken == stored + 1
    store.acknowledge(stored // 2)
    assert store.status.reason == ""
    assert store.write([evidence(10_000)]) == [stored + 2]
    assert_gapless(store)
    store.close()


def test_sessions_are_refused_before_a_running_one_finds_no_room(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    while not store.status.reason:
        assert not isinstance(store.write([evidence(1_000)])[0], SpoolFull)
    assert not isinstance(store.write([evidence(30_000)])[0], SpoolFull)
    store.close()


def test_telemetry_given_up_before_it_had_a_number_is_marked(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence()])
    assert store.write([evidence()], lost=7) == [9]
    assert [span(record) for record in everything(store)] == [range(1, 2), range(2, 9), range(9, 10)]
    assert store.status.dropped == 7
    store.acknowledge(4)
    assert [span(record) for record in everything(store)] == [range(5, 9), range(9, 10)]
    store.close()


def test_renewing_numbers_what_is_pending_from_one(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence(), telemetry(), evidence(50)], lost=3)
    before = store.status.spool
    store.renew()
    assert store.status.spool != before
    assert [(record.seq, record.kind) for record in everything(store)] == [(1, "step"), (2, "track"), (3, "step")]
    assert (store.status.last_seq, store.status.acknowledged) == (3, 0)
    assert store.write([evidence()]) == [4]
    assert_gapless(store)
    store.close()


def test_a_secret_is_taken_once_and_leaves_nothing_behind(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    secret = b"\x5a-private-key-\xa5" * 2
    store.state.put_secrets({"prekey/1": secret, "prekey/2": b"other"})
    with pytest.raises(SpoolError, match="exists already"):
        store.state.put_secrets({"prekey/3": b"x", "prekey/1": b"y"})
    assert store.state.secret_names() == ["prekey/1", "prekey/2"]
    assert store.state.take_secret("prekey/1") == secret
    assert store.state.take_secret("prekey/1") is None
    for path in tmp_path.iterdir():
        assert secret not in path.read_bytes(), path.name
    store.close()
    store = open_store(tmp_path)
    assert store.state.secret_names() == ["prekey/2"]
    store.close()


def test_the_files_are_private(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence()])
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert "spool.db-wal" in modes
    assert set(modes.values()) == {0o600}
    store.close()


def test_sessions_and_notes(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.state.put_session("s1", b'{"step":"poll"}')
    store.state.put_session("s1", b'{"step":"range"}')
    store.state.put_session("s2", b"{}")
    assert store.state.sessions() == {"s1": b'{"step":"range"}', "s2": b"{}"}
    store.write([Entry("session_end", T0, b"{}", evidence=True, ends_session="s1")])
    store.state.remove_session("s2")
    assert store.state.sessions() == {}
    assert store.state.note("checkpoint") is None
    store.state.put_note("checkpoint", b"17")
    store.state.put_note("checkpoint", b"18")
    assert store.state.note("checkpoint") == b"18"
    store.close()


def test_a_session_that_finds_no_room_for_its_end_is_still_there(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.state.put_session("s1", b"{}")
    (result,) = store.write([Entry("session_end", T0, b"x" * QUOTA, evidence=True, ends_session="s1")])
    assert isinstance(result, SpoolFull)
    assert list(store.state.sessions()) == ["s1"]
    store.close()


def test_another_pads_spool_is_refused(tmp_path: Path) -> None:
    open_store(tmp_path).close()
    with pytest.raises(SpoolError, match="belongs to pad 'pad-1', not 'pad-2'"):
        open_store(tmp_path, owner="pad-2")


def test_too_small_a_quota_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SpoolError, match="too small"):
        open_store(tmp_path, quota=1000)


def test_files_that_are_no_spool(tmp_path: Path) -> None:
    path = tmp_path / "spool.db"
    path.write_bytes(b"not a database, but long enough to look at" * 100)
    with pytest.raises(SpoolCorruptError, match="move the directory aside"):
        open_store(tmp_path)
    path.unlink()
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE something (x)")
    other.close()
    with pytest.raises(SpoolCorruptError, match="something else"):
        open_store(tmp_path)


def test_a_damaged_spool_is_said_to_be_damaged(tmp_path: Path) -> None:
    store = open_store(tmp_path)
    store.write([evidence(3_000) for _ in range(50)])
    store.close()
    path = tmp_path / "spool.db"
    data = bytearray(path.read_bytes())
    data[8192:] = b"\xee" * (len(data) - 8192)
    path.write_bytes(data)
    with pytest.raises(SpoolCorruptError):
        everything(open_store(tmp_path))


def test_a_later_format_is_refused(tmp_path: Path) -> None:
    open_store(tmp_path).close()
    with sqlite3.connect(tmp_path / "spool.db") as database:
        database.execute("PRAGMA user_version = 9")
    database.close()
    with pytest.raises(SpoolError, match="format 9"):
        open_store(tmp_path)


class SpoolMachine(RuleBasedStateMachine):
    """Against a list: what was stored as evidence is there until acknowledged, and every number is accounted for."""

    @initialize()
    def begin(self) -> None:
        import tempfile

        self.place = tempfile.TemporaryDirectory()
        self.store = open_store(Path(self.place.name))
        self.evidence: dict[int, bytes] = {}

    @rule(entries=st.lists(st.tuples(st.booleans(), st.sampled_from([10, 3_000, 40_000])), max_size=6))
    def write(self, entries: list[tuple[bool, int]]) -> None:
        given = [evidence(size) if kept else telemetry(size) for kept, size in entries]
        before = self.store.status
        results = self.store.write(given)
        numbers = [result for result in results if isinstance(result, int)]
        assert numbers == list(range(before.last_seq + 1, before.last_seq + 1 + len(numbers)))
        for entry, result in zip(given, results, strict=True):
            if isinstance(result, SpoolFull):
                assert entry.evidence
                assert before.evidence_bytes + sum(e.bytes for e in given if e.evidence) > QUOTA
            elif entry.evidence:
                self.evidence[result] = entry.body

    @rule(count=st.integers(1, 5))
    def lose(self, count: int) -> None:
        self.store.write([], lost=count)

    @rule(share=st.integers(0, 100))
    def acknowledge(self, share: int) -> None:
        status = self.store.status
        seq = status.acknowledged + (status.last_seq - status.acknowledged) * share // 100
        self.store.acknowledge(seq)
        self.evidence = {number: body for number, body in self.evidence.items() if number > seq}

    @rule()
    def restart(self) -> None:
        before = self.store.status
        self.store.close()
        self.store = open_store(Path(self.place.name))
        assert self.store.status == before

    @invariant()
    def whole(self) -> None:
        if not hasattr(self, "store"):
            return
        assert_gapless(self.store)
        records = everything(self.store)
        assert {record.seq: record.body for record in records if record.kind == "step"} == self.evidence
        status = self.store.status
        assert status.records == len(records)
        assert status.bytes == sum(64 + len(record.body) for record in records)
        assert status.evidence_bytes == sum(64 + len(record.body) for record in records if record.kind != "track")
        markers = [record for record in records if record.kind == "dropped"]
        assert status.bytes <= QUOTA + sum(64 + len(record.body) for record in markers)

    def teardown(self) -> None:
        if hasattr(self, "store"):
            self.store.close()
            self.place.cleanup()


TestSpoolMachine = SpoolMachine.TestCase
TestSpoolMachine.settings = settings(
    max_examples=25, stateful_step_count=25, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
