"""The SQLite store: whole blocks or none, and files that are not its own."""

import sqlite3

import pytest

from wonderland_fabric_gateway.embedded.errors import DirectoryError, LedgerCorruptedError, StorageError
from wonderland_fabric_gateway.embedded.rwset import Write
from wonderland_fabric_gateway.embedded.state import RANGE_PAGE, CommittedTx, StateReader, StateWriter, Tip, create


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "store.sqlite3"
    create(file)
    return file


def put(writer, number, *pairs, tx_id=None):
    writes = [Write("ns", key, value) for key, value in pairs]
    writer.stage_block(number, bytes([number]) * 32, b"block", [CommittedTx(tx_id or f"t{number}", 0, number, writes)])
    writer.commit(number)


def test_an_empty_store(path):
    reader = StateReader(path)
    assert reader.tip() == Tip(-1, b"")
    assert reader.block(0) is None
    assert reader.get("ns", "k") is None
    assert list(reader.range("ns", "", "")) == []
    assert reader.meta("x") is None
    reader.close()


def test_the_store_is_durable_and_in_wal_mode(path):
    reader = StateReader(path)
    assert reader._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert reader._db.execute("PRAGMA synchronous").fetchone() == (2,)
    with pytest.raises(sqlite3.OperationalError, match="readonly"):
        reader._db.execute("DELETE FROM block")
    reader.close()


def test_long_ranges_and_histories_come_in_pages_without_gap_or_double(path):
    writer, reader = StateWriter(path), StateReader(path)
    count = 2 * RANGE_PAGE + 3
    put(writer, 0, *((f"k{index:06}", b"%d" % index) for index in range(count)))
    assert [key for key, _, _ in reader.range("ns", "", "")] == [f"k{index:06}" for index in range(count)]
    assert [key for key, _, _ in reader.range("ns", "k000255", "k000258")] == ["k000255", "k000256", "k000257"]
    for number in range(1, 200):
        put(writer, number, ("h", b"%d" % number))
    writer.stage_block(
        200, b"later" * 7, b"block", [CommittedTx(f"m{index}", 0, 0, [Write("ns", "h", b"m")]) for index in range(100)]
    )
    writer.commit(200)
    history = list(reader.history("ns", "h"))
    assert [each.tx_id for each in history[:100]] == [f"m{index}" for index in reversed(range(100))]
    assert [each.value for each in history[100:]] == [b"%d" % number for number in reversed(range(1, 200))]
    reader.close()
    writer.close()


def test_a_snapshot_does_not_move(path):
    writer, reader = StateWriter(path), StateReader(path)
    put(writer, 0, ("k", b"old"))
    with reader.snapshot():
        assert reader.get("ns", "k")[0] == b"old"
        put(writer, 1, ("k", b"new"), ("l", b"new"))
        assert reader.get("ns", "k")[0] == b"old"
        assert [key for key, _, _ in reader.range("ns", "", "")] == ["k"]
    assert reader.get("ns", "k")[0] == b"new"
    reader.close()
    writer.close()


def test_a_full_disk_leaves_no_half_block(path):
    writer, reader = StateWriter(path), StateReader(path)
    put(writer, 0, ("k", b"v"))
    writer.limit_pages(1)  # SQLite takes the present size when it is larger
    with pytest.raises(StorageError) as caught:
        put(writer, 1, *((f"k{index}", b"x" * 3000) for index in range(50)))
    assert caught.value.full
    assert reader.tip().number == 0
    assert [key for key, _, _ in reader.range("ns", "", "")] == ["k"]
    assert reader.transaction("t1") is None
    writer.limit_pages(1 << 20)
    put(writer, 1, ("k", b"after"))
    assert reader.get("ns", "k") == (b"after", (1, 0))
    reader.close()
    writer.close()


def test_another_kind_of_failure_is_not_called_full(path):
    writer = StateWriter(path)
    put(writer, 0, ("k", b"v"))
    with pytest.raises(StorageError) as caught:
        put(writer, 0, ("k", b"v"))  # the block is there already
    assert not caught.value.full
    put(writer, 1, ("k", b"w"))
    writer.close()


def test_foreign_and_broken_files_are_refused(tmp_path):
    foreign = tmp_path / "foreign.sqlite3"
    db = sqlite3.connect(foreign)
    db.execute("CREATE TABLE mine (x)")
    db.close()
    with pytest.raises(DirectoryError, match="not a ledger's"):
        create(foreign)
    rubbish = tmp_path / "rubbish.sqlite3"
    rubbish.write_bytes(b"rubbish" * 1000)
    with pytest.raises(LedgerCorruptedError, match="no sound SQLite file"):
        create(rubbish)
    with pytest.raises(DirectoryError, match="cannot be opened"):
        create(tmp_path / "missing" / "store.sqlite3")


def test_a_store_of_another_version_is_refused(path):
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version=99")
    db.close()
    with pytest.raises(DirectoryError, match="another version"):
        create(path)
