"""The stage of the map's benchmarks: a backend in a process of its own, and browsers that show its console."""

from __future__ import annotations

import functools
import http.server
import json
import subprocess
import sys
import threading
from pathlib import Path
from urllib.parse import quote

import psutil
import pytest
from bench.chrome import Chrome
from bench.map_page import FLAGS, FLOOR, WATCH
from kit import environment
from kit.browser import FLAGS as CONSOLE_FLAGS
from kit.browser import FRONTEND, OFFLINE, chromium_on_path
from kit.console import Quiet

from wonderland_simulator.place.archive import is_whole
from wonderland_simulator.place.making import archive_path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MAPLIBRE = ROOT / "frontend" / "node_modules" / "maplibre-gl" / "dist"
VIEW = "at=60.45,22.25,11"
WIDTH, HEIGHT = 1280, 720


class Server:
    """`live_server.py` as a process."""

    def __init__(self, directory, mode, rate, *options):
        directory.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "bench.live_server", mode, str(rate), str(directory), *map(str, options)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment(), text=True
        )
        line = self.process.stdout.readline()
        assert line, "the server ended at once"
        ready = json.loads(line)
        self.link = ready["link"]
        self.url = f"http://127.0.0.1:{ready['port']}"

    def tell(self, line=""):
        """What it did so far."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def cpu_s(self):
        return sum(psutil.Process(self.process.pid).cpu_times()[:2])

    def close(self):
        self.process.stdin.close()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


def built_console():
    if not (FRONTEND / "dist" / "index.html").is_file():
        pytest.skip("the console is not built (make setup)")
    return FRONTEND / "dist"


def new_chrome(directory):
    """A browser with the watch in its page."""
    program = chromium_on_path()
    if program is None:
        pytest.skip("no Chromium here: neither playwright's own nor one on the PATH")
    chrome = Chrome(program, directory, *CONSOLE_FLAGS, *FLAGS, OFFLINE, width=WIDTH, height=HEIGHT)
    chrome.before_pages(WATCH)
    return chrome


def sign_in(chrome, server):
    chrome.goto(server.tell("link")["link"])
    chrome.wait_for("document.querySelector('[role=option]') !== null")


def open_map(chrome, server, count, view=VIEW):
    """The live map with at least so many drones, and its base map drawn."""
    sign_in(chrome, server)
    chrome.goto(f"{server.url}/#/live?{view}")
    chrome.wait_for(f"window.__seen.draws.some((count) => count >= {count})")


class FloorPage:
    """The bare layer, served beside the map's own library."""

    def __init__(self, directory, count, hz):
        for name in ("maplibre-gl.mjs", "maplibre-gl-worker.mjs"):
            if not (MAPLIBRE / name).is_file():
                pytest.skip("the console's packages are not installed (make setup)")
        directory.mkdir()
        (directory / "index.html").write_text(FLOOR)
        for name in ("maplibre-gl.mjs", "maplibre-gl-worker.mjs"):
            (directory / name).symlink_to(MAPLIBRE / name)
        handler = functools.partial(Quiet, directory=str(directory))
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        options = quote(json.dumps({"count": count, "hz": hz}))
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/index.html#{options}"

    def close(self):
        self._server.shutdown()
        self._server.server_close()


def place_archive():
    """The map of the demo's place, as set-up made it."""
    path = archive_path()
    if not is_whole(path):
        pytest.skip("the map of the demo's place is not at hand (python -m wonderland_simulator.place makes it)")
    return path


def cpu_s(chrome, kind=None):
    """Processor time of the browser, or of one kind of its processes (renderer, gpu-process)."""
    total = 0.0
    main = psutil.Process(chrome.process.pid)
    for each in (main, *main.children(recursive=True)):
        try:
            if kind is None or f"--type={kind}" in each.cmdline():
                total += sum(each.cpu_times()[:2])
        except psutil.Error:
            continue
    return total


def renderer_mb(chrome):
    """Resident memory of the renderer that has the page: the largest."""
    sizes = []
    for each in psutil.Process(chrome.process.pid).children(recursive=True):
        try:
            if "--type=renderer" in each.cmdline():
                sizes.append(each.memory_info().rss / 1e6)
        except psutil.Error:
            continue
    return max(sizes)
