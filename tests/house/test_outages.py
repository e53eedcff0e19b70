"""The instrument with which power is cut: it forgets what nobody flushed, and keeps what somebody did."""

from __future__ import annotations

import os

from wonderland_fabric_gateway.files import write_atomic


def test_the_disk_keeps_what_was_flushed_and_nothing_else(power):
    flushed, kept, lost = (power.directory / name for name in ("flushed", "kept", "lost"))
    for path in (flushed, lost):
        path.write_bytes(b"x" * 100_000)
    with flushed.open("rb") as file:
        os.fsync(file.fileno())
    write_atomic(kept, b"old")
    lost.rename(power.directory / "renamed")
    write_atomic(kept, b"new")
    (power.directory / "later").write_bytes(b"x")
    power.strike()
    power.back()
    assert {path.name for path in power.directory.iterdir()} >= {"flushed", "kept"}
    assert not (power.directory / "later").exists()
    assert flushed.read_bytes() == b"x" * 100_000
    assert kept.read_bytes() == b"new"
