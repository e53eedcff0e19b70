"""The live map in a browser that draws in software: frames beside a bare layer's, memory, first picture."""

from __future__ import annotations

import os
import statistics
import time
from dataclasses import dataclass, replace

import pytest
from bench.bench_tools import p50, p95, show
from bench.map_stage import (
    HEIGHT,
    VIEW,
    WIDTH,
    FloorPage,
    Server,
    built_console,
    cpu_s,
    new_chrome,
    open_map,
    place_archive,
    renderer_mb,
    sign_in,
)

pytestmark = [pytest.mark.bench, pytest.mark.browser, pytest.mark.timeout(4_000)]

COUNT, HZ = 10_000, 10
ROUNDS, ROUND_S = 4, 8
# Coasts of 7 MB are read and cut into tiles in the background after the first picture; frames are what comes then.
SETTLING_S = 15


PARTS = "performance.getEntriesByType('resource').filter(({ name }) => name.includes('/map/archive'))"
SCRIPTS = """performance.getEntriesByType('resource').filter(({ name }) => /\\.m?js$/.test(name))
    .reduce((sum, each) => sum + each.encodedBodySize, 0)"""


@pytest.fixture
def chrome(tmp_path):
    """A browser of its own, with the watch in its page."""
    opened = new_chrome(tmp_path / "chrome")
    yield opened
    opened.close()


@dataclass(frozen=True)
class Scene:
    """What a page looks at: so many drones, somewhere; on the map of the demo's place, or on coasts."""

    name: str
    count: int
    view: str
    field: str = ""

    def start(self, directory):
        """A real backend with one pad, ticking as often as its drones report."""
        options = ["--drones", self.count, "--tick-ms", 1000 // HZ, "--console", built_console()]
        if self.field:
            options += ["--map", place_archive(), "--field", self.field]
        return Server(directory, "hub", self.count * HZ, *options)


COASTS = Scene("coasts, flat", COUNT, VIEW)
PLACE = Scene("the place, flat", COUNT, "at=43.735,7.425,13.5", "43.735,7.425,0.12")
DEMO = Scene("the place, aslant with its buildings", 11, "at=43.7344,7.4250,16,-38,52", "43.7344,7.4250,0.02")
SCENES = [pytest.param(scene, id=name) for name, scene in (("coasts", COASTS), ("place", PLACE), ("aslant", DEMO))]
TOWN_SCENES = SCENES[:2]


@pytest.fixture
def scene(request):
    return request.param


@pytest.fixture
def server(scene, tmp_path):
    running = scene.start(tmp_path / "backend")
    yield running
    running.close()


class Watched:
    """What was seen of a page in all its turns."""

    def __init__(self, chrome, count):
        self.chrome = chrome
        self.count = count
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
        self.pictures += sum(count >= self.count for count in seen["draws"])

    def row(self, name):
        return (
            name,
            f"{p50(self.frames):.0f}",
            f"{p95(self.frames):.0f}",
            f"{min(self.turns):.0f}",
            f"{self.pictures / self.seconds:.1f}",
            f"{1000 * self.cpu_s / self.pictures:.0f}",
        )


@pytest.mark.parametrize("scene", SCENES, indirect=True)
def test_frames(chrome, scene, server, tmp_path, keep):
    """Drones that move ten times a second: frames beside those of a bare custom layer, turn by turn."""
    floor_page = FloorPage(tmp_path / "floor", scene.count, HZ)
    bare = new_chrome(tmp_path / "bare")
    try:
        bare.goto(floor_page.url)
        bare.wait_for("window.__seen && window.__seen.draws.length > 5")
        open_map(chrome, server, scene.count, scene.view)
        time.sleep(SETTLING_S)
        floor, live = Watched(bare, scene.count), Watched(chrome, scene.count)
        for _ in range(ROUNDS):
            server.tell("rate 0")
            floor.turn(ROUND_S)
            server.tell(f"rate {scene.count * HZ}")
            live.turn(ROUND_S)
    finally:
        bare.close()
        floor_page.close()
    assert live.pictures > ROUNDS
    ratios = [p50(live.frames) / p50(floor.frames), p95(live.frames) / p95(floor.frames)]
    cpu = (live.cpu_s / live.pictures) / (floor.cpu_s / floor.pictures)
    show(
        f"{scene.name}: {scene.count:,} drones at {HZ} Hz, software rendering, {WIDTH} × {HEIGHT}, {ROUNDS} turns of {ROUND_S} s each",
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


@pytest.mark.parametrize("scene", TOWN_SCENES, indirect=True)
def test_memory(chrome, scene, server, pytestconfig, keep):
    """The page's heap after collection and its process, under the same load (`--minutes`; 30 for the full run)."""
    full = os.environ.get("WONDERLAND_BENCH_FULL") == "1"
    minutes = 30 if full else pytestconfig.getoption("--minutes")
    open_map(chrome, server, scene.count, scene.view)
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
    show(
        f"Memory of the page over {minutes:g} min, {scene.name}, {scene.count:,} × {HZ} Hz",
        ("min", "heap MB", "renderer MB"),
        rows,
    )

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
    slope = statistics.linear_regression([at for at, _, _ in samples], [each for _, each, _ in samples]).slope
    print(f"heap after collection: {slope:+.2f} MB a minute")
    keep(heap_slope_mb_per_min=slope)
    keep(heap_first_mb=heap[0], heap_last_mb=heap[1], rss_first_mb=rss[0], rss_last_mb=rss[1], minutes=minutes)


@pytest.mark.parametrize("scene", TOWN_SCENES, indirect=True)
def test_first_picture(chrome, scene, tmp_path, keep):
    """From the address to drones on the map, and to the place under them, with a browser that has nothing cached."""
    server = replace(scene, count=50).start(tmp_path / "backend")
    times, grounds = [], []
    try:
        sign_in(chrome, server)
        for _ in range(5):
            chrome.call("Network.clearBrowserCache")
            chrome.goto("about:blank")
            chrome.wait_for("location.href === 'about:blank'")
            chrome.goto(f"{server.url}/#/live?{scene.view}")
            chrome.wait_for("window.__seen?.first !== undefined")
            if scene.field:
                # The last part of the archive that the picture needs has come, and nothing more is asked for.
                chrome.wait_for(f"{PARTS}.length > 2")
                time.sleep(3)
                grounds.append(chrome.evaluate(f"Math.max(...{PARTS}.map((each) => each.responseEnd))"))
            times.append(chrome.evaluate("window.__seen.first"))
            scripts = chrome.evaluate(SCRIPTS)
    finally:
        server.close()
    show(
        f"First usable map, nothing cached, {scene.name}",
        ("figure", "median of 5", "worst"),
        [
            ("drones on the map, ms", f"{p50(times):.0f}", f"{max(times):.0f}"),
            *([("the archive's last part, ms", f"{p50(grounds):.0f}", f"{max(grounds):.0f}")] if grounds else []),
            ("JavaScript as sent, kB", f"{scripts / 1000:.0f}", ""),
        ],
    )
    assert scripts > 0
    keep(first_map_ms=p50(times), first_map_worst_ms=max(times), scripts_bytes=scripts)
