"""Chromium: pages that are watched, and the built console that they show."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from playwright.sync_api import expect, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
FRONTEND = ROOT / "frontend"
ON_PATH = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
NOT_WANTED = (
    # Each window brings two pages of the address line's pop-up and a page in reserve: three times the price of a window.
    "WebUIOmniboxPopup",
    "WebUIOmniboxAimPopup",
    "AimEnabled",
    "SpareRendererForSitePerProcess",
    # What Playwright turns off by the same switch, of which the last one holds.
    "AvoidCorsURLLoaderRestartOnRedirect",
    "AvoidUnnecessaryBeforeUnloadCheckSync",
    "CDPScreenshotNewSurface",
    "DestroyProfileOnBrowserClose",
    "HttpsFirstBalancedModeAutoEnable",
    "HttpsUpgrades",
    "LensOverlay",
    "MediaRouter",
    "NetworkTimeServiceQuerying",
    "OptimizationHints",
    "PaintHolding",
    "PreconnectToSearch",
    "SkipListAccountsWithoutGaiaCookies",
    "ThirdPartyStoragePartitioning",
)
FLAGS = (
    "--no-sandbox",
    "--disable-features=" + ",".join(NOT_WANTED),
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-default-apps",
    "--disable-dev-shm-usage",
    # Pages are put together without a GPU that there is none of: a quarter less processor for the same picture.
    "--disable-gpu-compositing",
    "--in-process-gpu",
    "--num-raster-threads=1",
)
# What the browser says of its own way to draw.
OWN_WARNINGS = ("GPU stall due to ReadPixels",)
# How long a page may take: a software-drawn map on a machine that is also doing other tests can stand for many seconds.
PATIENCE_MS = 45_000
# Layout stays as it is; a map's canvas has a quarter of the points that software has to draw.
COARSE_CANVAS = "Object.defineProperty(window, 'devicePixelRatio', { get: () => 0.5 })"
# Nothing but this machine may be asked for anything.
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"


def chromium_program(playwright):
    """Playwright's own Chromium, else the system's, else None."""
    own = Path(playwright.chromium.executable_path)
    return str(own) if own.is_file() else chromium_on_path()


def chromium_on_path():
    """The system's Chromium, else None."""
    return next((found for name in ON_PATH if (found := shutil.which(name))), None)


@pytest.fixture(scope="module")
def reached():
    """The rule of which hosts the browser reaches; a folder's own fixture of this name may name more."""
    return OFFLINE


@pytest.fixture(scope="module")
def browser(reached):
    """Chromium, headless; its event loop ends with the module, so that other modules may have theirs."""
    try:
        # Its driver is a Node of its own, which a bare system may lack libraries for.
        manager = sync_playwright()
        playwright = manager.start()
    except Exception as error:  # noqa: BLE001 - playwright raises plain Exceptions
        pytest.skip(f"playwright's driver does not start here: {error}")
    try:
        program = chromium_program(playwright)
        if program is None:
            pytest.skip("no Chromium here: neither playwright's own nor one on the PATH")
        expect.set_options(timeout=PATIENCE_MS)
        running = playwright.chromium.launch(executable_path=program, args=[*FLAGS, reached])
        yield running
        running.close()
    finally:
        playwright.stop()


class Watched:
    """A page, and everything on it that should not be: errors, warnings, requests to elsewhere."""

    def __init__(self, page, origin):
        self.page = page
        self.origin = origin
        self.complaints = []
        self.expected = ()
        page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        page.on("console", self._hear)
        page.on("request", self._see)

    def _hear(self, message):
        if message.type in {"error", "warning"} and not any(each in message.text for each in OWN_WARNINGS):
            self.complaints.append(f"{message.type}: {message.text}")

    def _see(self, request):
        # The workers' own addresses (blob:) stay within the page.
        if not request.url.startswith((self.origin, "blob:", "data:")):
            self.complaints.append(f"request to {request.url}")

    def check(self):
        left = [each for each in self.complaints if not any(known in each for known in self.expected)]
        assert left == []


def _signed_in(context, link, room):
    """Spends a link's token without a page; the address of the room. A link by itself leads to the map."""
    base, _, token = link.partition("/#token=")
    answer = context.request.post(f"{base}/api/v1/session", data={"token": token}, headers={"Origin": base})
    assert answer.ok, answer.text()
    return f"{base}/#/{room}"


@pytest.fixture
def open_page(browser):
    """Opens an address in a browser of its own, a link (`room`) there: maps cost seconds to draw in software.

    Afterwards the page must not have complained.
    """
    contexts, pages = [], []

    def opened(url, *, width=1280, height=800, theme="light", calm=True, context=None, room=None):
        if context is None:
            context = browser.new_context(
                viewport={"width": width, "height": height},
                color_scheme=theme,
                reduced_motion="reduce" if calm else "no-preference",
                has_touch=width < 800,
            )
            context.add_init_script(COARSE_CANVAS)
            contexts.append(context)
        if room is not None:
            url = _signed_in(context, url, room)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        watched = Watched(page, "/".join(url.split("/", 3)[:3]))
        page.watched = watched
        pages.append(watched)
        page.goto(url)
        return page

    yield opened
    for context in contexts:
        context.close()
    for watched in pages:
        watched.check()


@pytest.fixture(scope="session")
def built_console():
    """The console as `make setup` builds it."""
    if not (FRONTEND / "dist" / "index.html").is_file():
        pytest.skip("the console is not built (make setup)")
    return FRONTEND / "dist"


def pytest_collection_modifyitems(items):
    """What needs a browser is marked so."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
