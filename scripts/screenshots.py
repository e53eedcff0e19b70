"""Takes the pictures of the documentation from a running demo: ``make screenshots`` (needs Chromium).

One demo for all of them: the link signs in one browser, and its session serves both themes. Pictures are WebP, so that
a checkout stays small; one that is larger than `LARGEST` bytes ends the run. Names of pictures as
arguments take only those.
"""

from __future__ import annotations

import io
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, StorageState, sync_playwright

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
SIZE = (1440, 900)
PHONE = (390, 844)
LARGEST = 200_000
QUALITY = 82
VERDICTS = 11
LINK_S = 60.0
PATIENCE_MS = 60_000
SETTLE_S = 2.5
LIAR = "OH-DRN-0417"


DRONES_CSV = b"uav_id;model;operator_id;registration\nOH-DRN-0900;Falcon 4;arctic-air;\nOH DRN 0901;;arctic-air;\n"


def _sign_out(page: Page) -> None:
    page.context.clear_cookies()
    page.reload()
    page.get_by_role("heading", name="Wonderland").wait_for()


def _sign(page: Page) -> None:
    """The last look before signing, with the demo's own key."""
    page.get_by_label("Reason").fill("Refuted at Hatter Quay")
    page.get_by_role("button", name="Check and sign").click()
    demo_key = page.get_by_role("button", name="Use the demo’s administrator key")
    demo_key.or_(page.get_by_role("button", name="Sign and send")).wait_for()
    if demo_key.is_visible():
        demo_key.click()
    page.get_by_role("button", name="Sign and send").wait_for()


def _check_file(page: Page) -> None:
    page.get_by_label("CSV file").set_input_files({"name": "drones.csv", "mimeType": "text/csv", "buffer": DRONES_CSV})
    page.get_by_role("button", name="Check the file").click()
    page.get_by_role("button", name="Go on with 1 line").wait_for()


@dataclass(frozen=True)
class Shot:
    """One picture: its name, the fragment of the address that it is of, and how it is looked at."""

    name: str
    place: str
    theme: str = "light"
    size: tuple[int, int] = SIZE
    prepare: Callable[[Page], None] | None = None
    """What is done there first."""


SHOTS = (
    Shot("place-light", "live"),
    Shot("live-dark", f"live?drone={LIAR}", "dark"),
    Shot("live-light", f"live?drone={LIAR}"),
    Shot("live-phone", f"live?drone={LIAR}", size=PHONE),
    Shot("table-light", "live?table"),
    Shot("wall-dark", "live?wall", "dark"),
    Shot("sessions-light", "sessions"),
    Shot("session-light", "sessions/{session}"),
    Shot("session-dark", "sessions/{session}", "dark"),
    Shot("verdicts-light", "verdicts"),
    Shot("alerts-light", "alerts"),
    Shot("alerts-dark", "alerts", "dark"),
    Shot("replay-light", "replay?t={decided}&session={session}"),
    Shot("drones-light", "registry/drones"),
    Shot("drone-light", f"registry/drones/{LIAR}"),
    Shot("signing-light", f"registry/drones/{LIAR}/suspend", prepare=_sign),
    Shot("pads-light", "registry/pads"),
    Shot("pad-light", "registry/pads/hatter-quay"),
    Shot("pad-dark", "registry/pads/hatter-quay", "dark"),
    Shot("operators-light", "registry/operators"),
    Shot("certificates-light", "registry/certificates"),
    Shot("import-light", "registry/import", prepare=_check_file),
    Shot("key-light", "registry/key"),
    Shot("ledger-light", "ledger"),
    Shot("block-light", "ledger/block/{block}"),
    Shot("transaction-light", "ledger/transaction/{tx}"),
    Shot("statistics-light", "statistics"),
    Shot("statistics-dark", "statistics", "dark"),
    Shot("people-light", "people"),
    Shot("invite-light", "people/invite"),
    Shot("machines-light", "people/clients"),
    Shot("account-light", "people/me"),
    Shot("audit-light", "people/audit"),
    Shot("zones-light", "zones"),
    Shot("settings-light", "settings"),
    # The last of its theme and size: it ends the session of its browser.
    Shot("sign-in-light", "settings", prepare=_sign_out),
)


def browser_path() -> str | None:
    """A Chromium of this machine; None lets Playwright use its own."""
    return next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )


def main() -> int:
    """Start the demo, wait for its verdicts, look at every page."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    demo = subprocess.Popen(
        [sys.executable, "-m", "wonderland.cli", "demo"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        link = _link(demo)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=browser_path(), args=list(FLAGS))
            state, names = _signed_in(browser, link, demo)
            for theme in ("light", "dark"):
                _take(browser, link.partition("#")[0], state, theme, names)
            browser.close()
    finally:
        demo.send_signal(signal.SIGINT)
        demo.wait(timeout=30)
    return 0


def link_in(line: str) -> str | None:
    """The link that signs in, where a line of the demo has it."""
    found = re.search(r"http://127\.0\.0\.1:\d+/#token=\S+", line)
    return None if found is None else found.group()


def _link(demo: subprocess.Popen[str]) -> str:
    assert demo.stdout is not None
    deadline = time.monotonic() + LINK_S
    for line in demo.stdout:
        if (link := link_in(line)) is not None:
            return link
        if time.monotonic() > deadline:
            break
    raise SystemExit("the demo printed no link")


def _signed_in(browser: Browser, link: str, demo: subprocess.Popen[str]) -> tuple[StorageState, dict[str, str]]:
    """The session's cookies, and what the addresses name: the liar's proof."""
    context = browser.new_context()
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(link)
    page.wait_for_selector("main.room")
    page.evaluate("localStorage.setItem('wonderland.tour', 'seen')")
    _wait_for_verdicts(demo)
    found = page.evaluate(f"fetch('/api/v1/verdicts?drone={LIAR}').then((answer) => answer.json())")
    state = context.storage_state()
    context.close()
    verdict = found["items"][0]
    decided = datetime.fromtimestamp(verdict["decided_ms"] / 1000 + 2, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return state, {
        "session": verdict["session_id"],
        "tx": verdict["tx_id"],
        "block": str(verdict["block"]),
        "decided": decided,
    }


def _wait_for_verdicts(demo: subprocess.Popen[str]) -> None:
    assert demo.stdout is not None
    seen = 0
    for line in demo.stdout:
        seen += " tx " in line
        if seen >= VERDICTS:
            break
    # What it says from now on must not fill the pipe.
    threading.Thread(target=demo.stdout.read, daemon=True).start()


def _take(browser: Browser, url: str, state: StorageState, theme: str, names: dict[str, str]) -> None:
    pages: dict[tuple[int, int], Page] = {}
    for shot in SHOTS:
        if shot.theme != theme or (sys.argv[1:] and shot.name not in sys.argv[1:]):
            continue
        if shot.size not in pages:
            width, height = shot.size
            context = browser.new_context(
                viewport={"width": width, "height": height},
                color_scheme="dark" if theme == "dark" else "light",
                reduced_motion="reduce",
                storage_state=state,
            )
            page = context.new_page()
            page.set_default_timeout(PATIENCE_MS)
            page.goto(f"{url}#/settings")
            page.wait_for_selector("main.room")
            pages[shot.size] = page
        page = pages[shot.size]
        page.evaluate("(hash) => { location.hash = hash; }", f"#/{shot.place.format(**names)}")
        page.wait_for_load_state("networkidle")
        page.wait_for_selector("main.room :is(h1, h2, table)")
        if shot.prepare is not None:
            shot.prepare(page)
        time.sleep(SETTLE_S)
        _keep(shot.name, page.screenshot())
    for page in pages.values():
        page.context.close()


def _keep(name: str, png: bytes) -> None:
    path = IMAGES / f"{name}.webp"
    with Image.open(io.BytesIO(png)) as picture:
        picture.convert("RGB").save(path, "WEBP", quality=QUALITY, method=6)
    size = path.stat().st_size
    print(f"{path.name}: {size // 1000} kB", flush=True)
    if size > LARGEST:
        raise SystemExit(f"{path.name} has {size} bytes; at most {LARGEST} are kept")


if __name__ == "__main__":
    sys.exit(main())
