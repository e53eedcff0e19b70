"""How a process ends that nobody asked to: killed, or its machine's power fails.

A killed process leaves to the system what it wrote, so it says nothing of flushes. `PowerCut` is an ext4 on a loop
device whose journal is dropped at the cut (EXT4_IOC_SHUTDOWN with NOLOGFLUSH, what fstests call *godown*): afterwards
there is what fsync had taken to the disk, and what the file system happened to write before.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import struct
import subprocess
import time
from pathlib import Path

import pytest

SHUTDOWN = 0x8004587D  # _IOR('X', 125, __u32)
NO_LOG_FLUSH = 2
DISK_BYTES = 64 << 20


def _freeze(pid):
    """Let none of its threads say anything any more; one in the middle of a flush stays there.

    A flush during the cut now and then succeeds for ext4 though nothing of it is on the disk (once in some hundred
    cuts on a busy machine, with write and fdatasync alone). After a real cut nobody hears such a promise.
    """
    with contextlib.suppress(ProcessLookupError, FileNotFoundError):
        os.kill(pid, signal.SIGSTOP)
        while any(
            (task / "stat").read_text().rpartition(")")[2].split()[0] in "RS"
            for task in Path(f"/proc/{pid}/task").iterdir()
        ):
            time.sleep(0.001)


class Killed:
    """A directory of this machine's; who works in it is killed."""

    def __init__(self, directory):
        self.directory = directory

    def strike(self, *pids):
        """They are gone, whatever they were doing."""
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def back(self):
        """Once the processes were waited for: the directory as a start after it finds it."""


class PowerCut(Killed):
    """A disk of its own, which the power leaves first."""

    def __init__(self, directory):
        self._disk, self._image = directory / "disk", directory / "disk.img"
        super().__init__(self._disk / "work")

    def insert(self):
        with self._image.open("wb") as image:
            image.truncate(DISK_BYTES)
        # A commit of the journal every five seconds, ext4's own rhythm, would save what nobody flushed.
        subprocess.run(["mkfs.ext4", "-q", "-F", self._image], check=True, capture_output=True)
        self._disk.mkdir()
        done = self._mount()
        if done.returncode == 0:
            self.directory.mkdir()
            os.sync()
        return done

    def _mount(self):
        options = "loop,commit=300,noauto_da_alloc"
        return subprocess.run(
            ["mount", "-o", options, self._image, self._disk], capture_output=True, text=True, check=False
        )

    def strike(self, *pids):
        for pid in pids:
            _freeze(pid)
        handle = os.open(self._disk, os.O_RDONLY)
        try:
            fcntl.ioctl(handle, SHUTDOWN, struct.pack("I", NO_LOG_FLUSH))
        finally:
            os.close(handle)
        super().strike(*pids)

    def back(self):
        subprocess.run(["umount", self._disk], check=True)
        done = self._mount()
        assert done.returncode == 0, done.stderr

    def remove(self):
        # Lazily: a test that failed may have left something open.
        subprocess.run(["umount", "-l", self._disk], check=True)


@pytest.fixture
def power(tmp_path):
    """A `PowerCut`; skipped where nothing can be mounted."""
    if os.geteuid() != 0:
        pytest.skip("a disk whose power fails can only be mounted by root")
    disk = PowerCut(tmp_path)
    try:
        done = disk.insert()
    except (FileNotFoundError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no disk whose power fails can be made here: {error}")
    if done.returncode:
        pytest.skip(f"no disk whose power fails can be mounted here: {done.stderr.strip()}")
    try:
        yield disk
    finally:
        disk.remove()


@pytest.fixture(params=["kill -9", "power cut"])
def outage(request, tmp_path):
    """Each of the two, in turn."""
    return Killed(tmp_path) if request.param == "kill -9" else request.getfixturevalue("power")
