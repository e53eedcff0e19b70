"""Films twenty seconds of a running demo in its place: ``make film`` (needs Chromium).

The browser's own screencast gives the frames with their times; clips are cut out of it around what the demo prints,
put together by the storyboard, and kept as one animated WebP, with fewer frames and less quality until it is small
enough for a checkout.
"""

from __future__ import annotations

import asyncio
import base64
import io
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from PIL import Image
from playwright.async_api import CDPSession, Page, async_playwright
from screenshots import FLAGS, IMAGES, LINK_S, PATIENCE_MS, browser_path, link_in

FILM: Final = IMAGES / "film.webp"
SIZE: Final = (1280, 800)
KEPT_SIZE: Final = (960, 600)
LARGEST: Final = 1_500_000
TRIES: Final = ((8, 60), (8, 45), (6, 45), (5, 35), (4, 30), (3, 25))
"""Frames a second and quality, from the best to the smallest."""
CUE_S: Final = 120.0
SETTLE_S: Final = 3.0


@dataclass(frozen=True)
class Clip:
    """A part of the film: where the page looks, and which seconds, counted from what the demo prints of a drone.

    Without a drone they are counted from when the page has settled there.
    """

    place: str
    first_s: float
    last_s: float
    drone: str = ""


QUAY: Final = "at=43.7345241,7.4278181,18.4,-38.0,52.0"
MOLE: Final = "at=43.7398900,7.4315500,18.4,24.0,50.0"
STORYBOARD: Final = (
    Clip("live", 0.0, 3.5),
    # An honest drone lands, and the liar comes to the same pad.
    Clip(f"live?{QUAY}", -1.5, 3.0, "OH-DRN-0233"),
    Clip(f"live?drone=OH-DRN-0417&{QUAY}", -2.5, 5.0, "OH-DRN-0417"),
    # Its radio falsifies its time stamps.
    Clip(f"live?drone=OH-DRN-0559&{MOLE}", -1.0, 4.5, "OH-DRN-0559"),
)
# Not `wait_for_function`: from its second look on it is eval, which the console's policy forbids.
GROUND_DRAWN: Final = """() => new Promise((drawn) => {
  const timer = setInterval(() => {
    if (!performance.getEntriesByType('resource').some(({ name }) => name.includes('/map/archive'))) return;
    clearInterval(timer);
    drawn();
  }, 100);
})"""


@dataclass
class Demo:
    """What the demo has printed: its link, and when it told which drone's verdict."""

    link: asyncio.Future[str]
    verdicts: dict[str, float] = field(default_factory=dict)
    spoken: asyncio.Condition = field(default_factory=asyncio.Condition)

    async def listen(self, stream: asyncio.StreamReader) -> None:
        """Until it ends."""
        async for raw in stream:
            line = raw.decode(errors="replace")
            if (link := link_in(line)) is not None and not self.link.done():
                self.link.set_result(link)
            if " tx " in line:
                async with self.spoken:
                    for clip in STORYBOARD:
                        if clip.drone and clip.drone in line:
                            self.verdicts.setdefault(clip.drone, time.time())
                    self.spoken.notify_all()

    async def verdict_of(self, drone: str) -> float:
        """When it was told; waits for it."""
        async with asyncio.timeout(CUE_S), self.spoken:
            await self.spoken.wait_for(lambda: drone in self.verdicts)
        return self.verdicts[drone]


@dataclass
class Camera:
    """Everything that was painted, with its time."""

    frames: list[tuple[float, bytes]] = field(default_factory=list)
    _tasks: set[asyncio.Task[Any]] = field(default_factory=set)

    async def begin(self, session: CDPSession) -> None:
        """From now on."""

        def painted(event: dict[str, Any]) -> None:
            self.frames.append((event["metadata"]["timestamp"], base64.b64decode(event["data"])))
            task = asyncio.ensure_future(session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]}))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

        session.on("Page.screencastFrame", painted)
        size = {"maxWidth": KEPT_SIZE[0], "maxHeight": KEPT_SIZE[1]}
        await session.send("Page.startScreencast", {"format": "jpeg", "quality": 92, **size})

    def cut(self, first_s: float, last_s: float, per_s: int) -> list[bytes]:
        """So many frames a second: each the last one that was painted by then."""
        found = []
        for number in range(round((last_s - first_s) * per_s)):
            until_s = first_s + number / per_s
            painted = [data for at_s, data in self.frames if at_s <= until_s]
            found.append(painted[-1] if painted else self.frames[0][1])
        return found


async def film(page: Page, demo: Demo) -> list[tuple[float, float]]:
    """Goes where the storyboard leads; returns the seconds of its clips."""
    cuts = []
    place = ""
    for clip in STORYBOARD:
        if clip.place != place:
            place = clip.place
            await page.evaluate("(hash) => { location.hash = hash; }", f"#/{place}")
            if not clip.drone:
                await page.wait_for_selector(".map-drones")
                await page.evaluate(GROUND_DRAWN)
                await asyncio.sleep(SETTLE_S)
        base = await demo.verdict_of(clip.drone) if clip.drone else time.time()
        await asyncio.sleep(max(0.0, base + clip.last_s - time.time()))
        cuts.append((base + clip.first_s, base + clip.last_s))
    return cuts


def keep(camera: Camera, cuts: list[tuple[float, float]], target: Path) -> None:
    """As good as fits."""
    for per_s, quality in TRIES:
        pictures = []
        for first_s, last_s in cuts:
            for data in camera.cut(first_s, last_s, per_s):
                with Image.open(io.BytesIO(data)) as picture:
                    pictures.append(picture.convert("RGB"))
        out = io.BytesIO()
        options = {"duration": 1000 // per_s, "loop": 0, "quality": quality, "method": 4}
        pictures[0].save(out, "WEBP", save_all=True, append_images=pictures[1:], **options)
        size = len(out.getvalue())
        print(f"{len(pictures)} frames, {per_s} a second, quality {quality}: {size // 1000} kB", flush=True)
        if size <= LARGEST:
            target.write_bytes(out.getvalue())
            return
    raise SystemExit(f"no film of at most {LARGEST} bytes")


async def main() -> None:
    """Start the demo, film it."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else FILM
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "wonderland.cli", "demo", stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    assert process.stdout is not None
    demo = Demo(asyncio.get_running_loop().create_future())
    listening = asyncio.create_task(demo.listen(process.stdout))
    camera = Camera()
    try:
        async with asyncio.timeout(LINK_S):
            link = await demo.link
        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(executable_path=browser_path(), args=list(FLAGS))
            context = await browser.new_context(
                viewport={"width": SIZE[0], "height": SIZE[1]}, color_scheme="light", reduced_motion="no-preference"
            )
            page = await context.new_page()
            page.set_default_timeout(PATIENCE_MS)
            await page.add_init_script("localStorage.setItem('wonderland.tour', 'seen')")
            await page.goto(link)
            await page.wait_for_selector("main.room")
            await camera.begin(await context.new_cdp_session(page))
            cuts = await film(page, demo)
            await browser.close()
    finally:
        process.send_signal(signal.SIGINT)
        await process.wait()
        await listening
    keep(camera, cuts, target)


if __name__ == "__main__":
    asyncio.run(main())
