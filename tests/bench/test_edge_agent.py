"""What a pad's agent costs: the real process, in sessions at 20 Hz, its nodes on pseudo-terminals."""

from __future__ import annotations

import asyncio
import time

import psutil
import pytest
from bench.bench_sessions import sessions
from bench.bench_tools import p50, p95, show

from wonderland.proofs.records.policies import Policy

SESSIONS = 4
ROUNDS = 160
IDLE_S = 5.0
SAMPLE_S = 0.2

pytestmark = pytest.mark.bench


class Watch:
    """Samples a process while a block runs: CPU seconds, wall seconds, largest resident memory (MB)."""

    def __init__(self, pid):
        self._process = psutil.Process(pid)
        self.cpu_s = self.wall_s = 0.0
        self.rss_mb = []

    def _cpu(self):
        times = self._process.cpu_times()
        return times.user + times.system

    async def __aenter__(self):
        self._cpu_s, self._start = self._cpu(), time.perf_counter()
        self._task = asyncio.create_task(self._sample())
        return self

    async def __aexit__(self, *_):
        self._task.cancel()
        self.cpu_s, self.wall_s = self._cpu() - self._cpu_s, time.perf_counter() - self._start

    async def _sample(self):
        while True:
            self.rss_mb.append(self._process.memory_info().rss / 1e6)
            await asyncio.sleep(SAMPLE_S)

    @property
    def core(self):
        """Share of one core."""
        return self.cpu_s / self.wall_s


async def test_memory_and_processor(tmp_path, keep):
    # The pad may not settle before the last round, so that each session ranges for eight seconds.
    policy = Policy(min_assurance=2, min_rounds=ROUNDS, max_rounds=ROUNDS)
    async with sessions(tmp_path, policy=policy) as proving:
        pid = proving.pid(f"pad-{proving.pad_id}")
        await proving.prove()
        async with Watch(pid) as idle:
            await asyncio.sleep(IDLE_S)
        watches = []
        for _ in range(SESSIONS):
            async with Watch(pid) as watch:
                result = await proving.prove()
            assert result.verdict.rounds == ROUNDS
            watches.append(watch)
        unique_mb = psutil.Process(pid).memory_full_info().uss / 1e6
    peak = max(max(watch.rss_mb) for watch in watches)
    cores = [watch.core for watch in watches]
    show(
        f"wonderland pad run: {SESSIONS} sessions of {ROUNDS} rounds at 20 Hz, four nodes, {p50([w.wall_s for w in watches]):.1f} s each",
        ("figure", "value", "goal"),
        [
            ("resident memory, idle", f"{max(idle.rss_mb):.1f} MB", ""),
            ("resident memory, peak", f"{peak:.1f} MB", "≤ 60 MB"),
            ("of it private (the rest: code of gRPC, OpenSSL, Python)", f"{unique_mb:.1f} MB", ""),
            ("core, idle", f"{idle.core:.2%}", ""),
            ("core in a session, p50 / p95", f"{p50(cores):.1%} / {p95(cores):.1%}", "≤ 5 %"),
            ("CPU of a session", f"{p50([w.cpu_s for w in watches]) * 1e3:.0f} ms", ""),
        ],
    )
    keep(peak_rss_mb=peak, private_mb=unique_mb, core=p50(cores), idle_core=idle.core)
