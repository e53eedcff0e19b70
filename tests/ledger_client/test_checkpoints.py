"""Checkpoints survive, and damage is never taken for a beginning."""

from __future__ import annotations

import sqlite3

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.checkpoints import (
    MAX_BLOCK_NUMBER,
    Checkpoint,
    FileCheckpointer,
    MemoryCheckpointer,
    SqliteCheckpointer,
)
from wonderland_fabric_gateway.errors import CheckpointError

MODERATE = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def database():
    connection = sqlite3.connect(":memory:")
    yield connection
    connection.close()


@pytest.fixture(params=["memory", "file", "sqlite"])
def checkpointer(request, tmp_path, database):
    if request.param == "memory":
        return MemoryCheckpointer()
    if request.param == "file":
        return FileCheckpointer(tmp_path / "checkpoint.json")
    keeper = SqliteCheckpointer(database, "mirror")
    keeper.create_table()
    return keeper


@MODERATE
@given(st.integers(0, MAX_BLOCK_NUMBER), st.from_regex(r"[0-9a-f]{0,64}", fullmatch=True))
def test_what_is_saved_is_loaded(checkpointer, number, tx_id):
    checkpointer.save(Checkpoint(number, tx_id))
    assert checkpointer.load() == Checkpoint(number, tx_id)


def test_nothing_saved_is_none(checkpointer):
    assert checkpointer.load() is None


def test_after_a_block_is_the_next_block():
    assert Checkpoint.after_block(4) == Checkpoint(5, "")


@pytest.mark.parametrize(
    ("number", "tx_id"), [(-1, ""), (1 << 63, ""), (True, ""), ("1", ""), (1, "a b"), (1, None), (1, "x" * 129)]
)
def test_what_is_no_checkpoint(number, tx_id):
    with pytest.raises(CheckpointError):
        Checkpoint(number, tx_id)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"{}",
        b"\xff",
        b'{"block_number":1}',
        b'{"block_number":"1","transaction_id":""}',
        b"x" * 5000,
        b'{"block_number":-1,"transaction_id":""}',
        b'{"block_number":1,"transaction_id":null}',
    ],
)
def test_a_damaged_file_raises(tmp_path, content):
    path = tmp_path / "checkpoint.json"
    path.write_bytes(content)
    with pytest.raises(CheckpointError):
        FileCheckpointer(path).load()
    assert path.read_bytes() == content


def test_an_unreadable_file_raises(tmp_path):
    (tmp_path / "checkpoint.json").mkdir()
    with pytest.raises(CheckpointError, match="cannot read"):
        FileCheckpointer(tmp_path / "checkpoint.json").load()


def test_a_file_that_cannot_be_written_keeps_the_former_one(tmp_path, monkeypatch):
    keeper = FileCheckpointer(tmp_path / "checkpoint.json")
    keeper.save(Checkpoint(1, "a"))

    def full(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(CheckpointError, match="No space left"):
        keeper.save(Checkpoint(2, "b"))
    assert keeper.load() == Checkpoint(1, "a")
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.json"]  # no temporary file stays


def test_the_database_row_commits_with_the_rest(tmp_path):
    database = sqlite3.connect(tmp_path / "rows.db")
    keeper = SqliteCheckpointer(database, "mirror")
    keeper.create_table()
    keeper.save(Checkpoint(1, "a"))
    database.commit()
    keeper.save(Checkpoint(2, "b"))
    database.rollback()
    assert keeper.load() == Checkpoint(1, "a")
    assert SqliteCheckpointer(database, "another").load() is None
    database.close()


def test_a_database_without_the_table_raises(database):
    with pytest.raises(CheckpointError, match="no such table"):
        SqliteCheckpointer(database, "mirror").load()
