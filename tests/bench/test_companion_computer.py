"""The agents on a computer of the Raspberry Pi class: each in a control group of its own, with less of a core and memory.

A real drone's and a real pad's agent range 160 rounds as fast as the plan has them, first without limits and then with them. A group's
processor is given in slices of 10 ms, as a slower core would take its time, not in one long pause.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from pathlib import Path

import pytest
from bench.bench_sessions import UAV_ID, played
from bench.bench_tools import p50, show

from wonderland.proofs.records.policies import Policy
from wonderland_simulator.world import drone_path

ROUNDS = 160
SESSIONS = 3
MEMORY_BYTES = 128 * 1024 * 1024
PERIOD_US = 10_000
GROUPS = Path("/sys/fs/cgroup")

pytestmark = [pytest.mark.bench, pytest.mark.timeout(600)]


def one_ghz():
    """What part of a core of this machine has 1 GHz."""
    rates = [float(line.split(":")[1]) for line in Path("/proc/cpuinfo").read_text().splitlines() if "cpu MHz" in line]
    if not rates:
        pytest.skip("/proc/cpuinfo says no MHz")
    return min(1.0, 1_000 / max(rates))


class Computer:
    """A control group, of the first or the second kind; what runs in it has no more than that."""

    def __init__(self, name, core):
        self._second = (GROUPS / "cgroup.controllers").exists()
        self.parts = [GROUPS / name] if self._second else [GROUPS / kind / name for kind in ("cpu", "memory")]
        self._cpu, self._memory = self.parts[0], self.parts[-1]
        self.close()  # of a run that was killed
        try:
            for part in self.parts:
                part.mkdir()
            if self._second:
                (GROUPS / "cgroup.subtree_control").write_text("+cpu +memory")
                (self._memory / "memory.max").write_text(str(MEMORY_BYTES))
                if core is not None:
                    (self._cpu / "cpu.max").write_text(f"{round(core * PERIOD_US)} {PERIOD_US}")
            else:
                (self._memory / "memory.limit_in_bytes").write_text(str(MEMORY_BYTES))
                if core is not None:
                    (self._cpu / "cpu.cfs_period_us").write_text(str(PERIOD_US))
                    (self._cpu / "cpu.cfs_quota_us").write_text(str(round(core * PERIOD_US)))
        except OSError as error:
            self.close()
            pytest.skip(f"needs control groups that it may write (as root): {error}")

    @contextlib.contextmanager
    def starting(self):
        """What is started meanwhile begins there, as this process is there itself."""
        mine = dict(line.split(":", 2)[1:] for line in Path("/proc/self/cgroup").read_text().splitlines())
        before = [part.parent / mine["" if self._second else part.parent.name].strip("/") for part in self.parts]
        try:
            for part in self.parts:
                (part / "cgroup.procs").write_text(str(os.getpid()))
            yield
        finally:
            for part in before:
                (part / "cgroup.procs").write_text(str(os.getpid()))

    @property
    def peak_mb(self):
        """Page cache included, which the limit counts as well."""
        name = "memory.peak" if self._second else "memory.max_usage_in_bytes"
        return int((self._memory / name).read_text()) / 1e6

    def close(self):
        for part in self.parts:
            with contextlib.suppress(OSError):
                for pid in (part / "cgroup.procs").read_text().split():
                    (part.parent / "cgroup.procs").write_text(pid)
                part.rmdir()


async def prove(computer, stage, directory):
    """`wonderland uav prove` on that computer: what it printed."""
    command = [
        *(Path(sys.executable).with_name("wonderland"), "uav", "prove", "--pad", stage.settings.pads[0].pad_id),
        *("--connection", stage.connection_file, "--identity", UAV_ID, "--json"),
        *("--port", drone_path(directory, UAV_ID), "--position", f"udp:127.0.0.1:{stage.ports.position[UAV_ID]}"),
    ]
    with computer.starting():
        process = await asyncio.create_subprocess_exec(
            *map(str, command), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
        )
    out, err = await process.communicate()
    assert process.returncode == 0, (out + err).decode()
    return json.loads(out)


async def test_the_rate_of_ranging_is_kept(tmp_path, keep):
    policy = Policy(min_assurance=2, min_rounds=ROUNDS, max_rounds=ROUNDS)
    rows, figures = [], {}
    for name, core in (("a whole core", None), ("1 GHz of it", one_ghz()), ("a fifth of it", 0.2)):
        with (
            contextlib.closing(Computer("wonderland-bench-pad", core)) as of_pad,
            contextlib.closing(Computer("wonderland-bench-uav", core)) as of_drone,
        ):
            directory = tmp_path / name.replace(" ", "-")
            directory.mkdir()
            async with played(directory, policy=policy, starting=of_pad.starting) as stage:
                done = [await prove(of_drone, stage, directory) for _ in range(SESSIONS)]
            pad_mb, drone_mb = of_pad.peak_mb, of_drone.peak_mb
            verdicts = [each["verdict"] for each in done]
            assert {(each["outcome"], each["rounds"]) for each in verdicts} == {("verified", ROUNDS)}
            steps = [{step["step"]: step["t_ms"] for step in each["steps"]} for each in done]
            a_second = p50([1e3 * ROUNDS / (each["range"] - each["reply"]) for each in steps])
            took_s = p50([(each["verdict"] - each["request"]) / 1e3 for each in steps])
            rows.append((name, f"{a_second:.1f}", f"{took_s:.1f}", f"{pad_mb:.0f}", f"{drone_mb:.0f}"))
            figures |= {f"{name}: rounds/s": a_second, f"{name}: pad MB": pad_mb, f"{name}: drone MB": drone_mb}
    keep(**figures)
    show(
        f"{SESSIONS} proofs of {ROUNDS} rounds, each agent with 128 MiB and",
        ("processor", "rounds/s", "request to verdict, s", "pad peak MB", "drone peak MB"),
        rows,
    )
