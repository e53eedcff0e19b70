"""Takes the pictures of the documentation from a running demo: ``make screenshots`` (needs Chromium)."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-dev-shm-usage",
)
SIZE = {"width": 1440, "height": 900}
VERDICTS = 8
LINK_S = 60.0
SETTLE_S = 3.0


def browser_path() -> str | None:
    """A Chromium of this machine; None lets Playwright use its own."""
    return next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )


def main() -> int:
    """One demo for each theme, since a link signs in once."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    for theme in ("dark", "light"):
        demo = subprocess.Popen(
            [sys.executable, "-m", "wonderland.cli", "demo"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            link = _link(demo)
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=browser_path(), args=list(FLAGS))
                context = browser.new_context(viewport=SIZE, color_scheme=theme)  # type: ignore[arg-type]
                page = context.new_page()
                page.goto(link)
                _wait_for_verdicts(demo)
                _take(page, theme)
                browser.close()
        finally:
            demo.send_signal(signal.SIGINT)
            demo.wait(timeout=30)
    return 0


def _link(demo: subprocess.Popen[str]) -> str:
    assert demo.stdout is not None
    deadline = time.monotonic() + LINK_S
    for line in demo.stdout:
        if match := re.search(r"http://127\.0\.0\.1:\d+/#token=\S+", line):
            return match.group()
        if time.monotonic() > deadline:
            break
    raise SystemExit("the demo printed no link")


def _wait_for_verdicts(demo: subprocess.Popen[str]) -> None:
    assert demo.stdout is not None
    seen = 0
    for line in demo.stdout:
        seen += " tx " in line
        if seen >= VERDICTS:
            return


def _take(page: Page, theme: str) -> None:
    time.sleep(SETTLE_S)
    page.screenshot(path=IMAGES / f"map-{theme}.png")
    page.get_by_text("OH-DRN-0417").first.click()
    time.sleep(SETTLE_S)
    page.screenshot(path=IMAGES / f"live-{theme}.png")
    for name in ("Sessions", "Verdicts"):
        page.get_by_role("link", name=name).first.click()
        time.sleep(SETTLE_S)
        page.screenshot(path=IMAGES / f"{name.lower()}-{theme}.png")


if __name__ == "__main__":
    sys.exit(main())
