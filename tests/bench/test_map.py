"""The live map in a browser that draws in software: frames beside a bare layer's, memory, first picture."""

from __future__ import annotations

import os
import time

import pytest
from bench_tools import p50, p95, show
from map_stage import (
    HEIGHT,
    VIEW,
    WIDTH,
    FloorPage,
    Server,
    built_console,
    cpu_s,
    new_chrome,
    open_map,
    renderer_mb,
    sign_in,
)

pytestmark = [pytest.mark.bench, pytest.mark.browser, pytest.mark.timeout(4_000)]

COUNT, HZ = 10_000, 10
ROUNDS, ROUND_S = 4, 8
# Coasts of 7 MB are read and cut into tiles in the background after the first picture; frames are what comes then.
SETTLING_S = 15


@pytest.fixture
def chrome(tmp_path):
    """A browser of its own, with the watch in its page."""
    opened = new_chrome(tmp_path / "chrome")
    yield opened
    opened.close()


@pytest.fixture
def server(tmp_path):
    """A real backend with one pad, ticking as often as its drones report."""
    options = ("--drones", COUNT, "--tick-ms", 1000 // HZ, "--console", built_console())
    running = Server(tmp_path / "backend", "hub", COUNT * HZ, *options)
    yield running
    running.close()


class Watched:
    """What was seen of a page in all its turns."""

    def __init__(self, chrome):
        self.chrome = chrome
        self.frames, self.turns = [], []
        self.pictures = 0
        self.cpu_s = self.seconds = 0.0

    def turn(self, seconds):
        self.chrome.evaluate("window.__seen.watch(true)")
        # What stood still begins again.
        time.sleep(1)
        self.chrome.evaluate("window.__seen.watch(true)")
        began, cpu = time.monotonic(), cpu_s(self.chrome)
        time.sleep(seconds)
        seen = self.chrome.evaluate("({ frames: window.__seen.frames, draws: window.__seen.draws })")
        self.cpu_s += cpu_s(self.chrome) - cpu
        self.seconds += time.monotonic() - began
        self.chrome.evaluate("window.__seen.watch(false)")
        self.frames += seen["frames"]
        self.turns.append(p95(seen["frames"]))
        self.pictures += sum(count >= COUNT for count in seen["draws"])

    def row(self, name):
        return (
            name,
            f"{p50(self.frames):.0f}",
            f"{p95(self.frames):.0f}",
            f"{min(self.turns):.0f}",
            f"{self.pictures / self.seconds:.1f}",
            f"{1000 * self.cpu_s / self.pictures:.0f}",
        )


def test_frames(chrome, server, tmp_path, keep):
    """10,000 drones ten times a second: frames beside those of a bare custom layer, turn by turn."""
    floor_page = FloorPage(tmp_path / "floor", COUNT, HZ)
    bare = new_chrome(tmp_path / "bare")
    try:
        bare.goto(floor_page.url)
        bare.wait_for("window.__seen && window.__seen.draws.length > 5")
        open_map(chrome, server, COUNT)
        time.sleep(SETTLING_S)
        floor, live = Watched(bare), Watched(chrome)
        for _ in range(ROUNDS):
            server.tell("rate 0")
            floor.turn(ROUND_S)
            server.tell(f"rate {COUNT * HZ}")
            live.turn(ROUND_S)
    finally:
        bare.close()
        floor_page.close()
    assert live.pictures > ROUNDS
    ratios = [p50(live.frames) / p50(floor.frames), p95(live.frames) / p95(floor.frames)]
    cpu = (live.cpu_s / live.pictures) / (floor.cpu_s / floor.pictures)
    show(
        f"{COUNT:,} drones at {HZ} Hz, software rendering, {WIDTH} × {HEIGHT}, {ROUNDS} turns of {ROUND_S} s each",
        ("what", "frame p50 ms", "p95 ms", "p95 of the best turn", "pictures/s", "browser's CPU ms a picture"),
        [
            floor.row("bare custom layer"),
            live.row("the live map"),
            (
                "ratio",
                f"{ratios[0]:.2f}",
                f"{ratios[1]:.2f}",
                f"{min(live.turns) / min(floor.turns):.2f}",
                f"{live.pictures / live.seconds / (floor.pictures / floor.seconds):.2f}",
                f"{cpu:.2f}",
            ),
        ],
    )
    keep(
        frame_p50_ms=p50(live.frames),
        frame_p95_ms=p95(live.frames),
        floor_p50_ms=p50(floor.frames),
        floor_p95_ms=p95(floor.frames),
        best_p95_ms=min(live.turns),
        floor_best_p95_ms=min(floor.turns),
        pictures_per_s=live.pictures / live.seconds,
        cpu_ratio=cpu,
    )


def heap_mb(chrome):
    return chrome.evaluate("(gc(), performance.memory.usedJSHeapSize / 1e6)")


def test_memory(chrome, server, pytestconfig, keep):
    """The page's heap after collection and its process, under the same load (`--minutes`; 30 for the full run)."""
    full = os.environ.get("WONDERLAND_BENCH_FULL") == "1"
    minutes = 30 if full else pytestconfig.getoption("--minutes")
    open_map(chrome, server, COUNT)
    # The trails fill for a minute; what comes after that should not grow.
    time.sleep(min(70, minutes * 60))
    samples = []
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < minutes * 60 or len(samples) < 6:
        time.sleep(max(2, minutes))
        samples.append((elapsed / 60, heap_mb(chrome), renderer_mb(chrome)))
    assert server.tell()["frames"] > 0
    third = len(samples) // 3
    rows = [(f"{at:.1f}", f"{heap:.1f}", f"{rss:.0f}") for at, heap, rss in samples[:: max(1, len(samples) // 15)]]
    show(f"Memory of the page over {minutes:g} min at {COUNT:,} × {HZ} Hz", ("min", "heap MB", "renderer MB"), rows)

    def mean(part, column):
        return sum(sample[column] for sample in part) / len(part)

    heap = mean(samples[:third], 1), mean(samples[-third:], 1)
    rss = mean(samples[:third], 2), mean(samples[-third:], 2)
    show(
        "First and last third",
        ("figure", "first MB", "last MB", "growth"),
        [
            ("heap after collection", f"{heap[0]:.1f}", f"{heap[1]:.1f}", f"{heap[1] - heap[0]:+.1f}"),
            ("renderer, resident", f"{rss[0]:.0f}", f"{rss[1]:.0f}", f"{rss[1] - rss[0]:+.0f}"),
        ],
    )
    keep(heap_first_mb=heap[0], heap_last_mb=heap[1], rss_first_mb=rss[0], rss_last_mb=rss[1], minutes=minutes)


def test_first_picture(chrome, tmp_path, keep):
    """From the address to drones on the map, with a browser that has nothing cached."""
    server = Server(tmp_path / "backend", "hub", 50, "--console", built_console())
    try:
        sign_in(chrome, server)
        times = []
        for _ in range(5):
            chrome.call("Network.clearBrowserCache")
            chrome.goto("about:blank")
            chrome.wait_for("location.href === 'about:blank'")
            chrome.goto(f"{server.url}/#/live?{VIEW}")
            chrome.wait_for("window.__seen?.first !== undefined")
            times.append(chrome.evaluate("window.__seen.first"))
    finally:
        server.close()
    show(
        "First usable map, nothing cached",
        ("figure", "ms"),
        [("median of 5", f"{p50(times):.0f}"), ("worst", f"{max(times):.0f}")],
    )
    keep(first_map_ms=p50(times), first_map_worst_ms=max(times))
