"""A position's way to the screen: in at the ingest or at a pad's receiver, out as a point that Chromium has drawn."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest
from bench.bench_tools import p50, p95, show
from bench.map_page import beacon
from bench.map_stage import Server, built_console, new_chrome, open_map
from bench.test_live_push import Viewer, cookie_of
from kit import environment

from wonderland_remote_id import BasicId, Location, Pack, encode

pytestmark = [pytest.mark.bench, pytest.mark.browser, pytest.mark.timeout(900)]

HERE = Path(__file__).parent
RATE, PADS = 2_500, 10
SECONDS = 20
SETTLING_S = 10
# Drones that one receiver hears, once a second each.
HEARD = 20


class Load:
    """`pad_load.py` as a process."""

    def __init__(self, mode, server, directory, *options):
        url = server.url.replace("http", "ws", 1) + "/ingest"
        command = [sys.executable, "-m", "bench.pad_load", mode, url, str(directory / "pads.json")]
        self.process = subprocess.Popen(
            [*command, *map(str, options)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment(), text=True
        )
        line = self.process.stdout.readline()
        assert line, "the pads ended at once"
        self.ready = json.loads(line)

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


class Viewers:
    """So many consoles as bare sockets, in a thread."""

    def __init__(self, server, count):
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.viewers = [Viewer(looks=number == 0) for number in range(count)]
        port = int(server.url.rpartition(":")[2])
        cookie = asyncio.run_coroutine_threadsafe(cookie_of(server.link), self._loop).result(30)
        self._tasks = [
            # The first one looks into its bytes and takes text; the others take what a console takes.
            asyncio.run_coroutine_threadsafe(
                each.run(port, "/api/v1/live" if number == 0 else "/api/v1/live?packed=zlib", cookie), self._loop
            )
            for number, each in enumerate(self.viewers)
        ]

    def ages_ms(self):
        """How old positions were when the first console's socket had them, since the last call."""
        found, self.viewers[0].ages_ms = self.viewers[0].ages_ms, []
        return found

    def alive(self):
        return not any(task.done() for task in self._tasks)

    def close(self):
        for task in self._tasks:
            task.cancel()
        time.sleep(0.2)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


def spent(server, load, seconds):
    """(share of a core of the backend, of the pads; positions a second) over a while."""
    began, cpu, pads, heard = time.monotonic(), server.cpu_s(), load.cpu_s(), server.tell()["heard"]
    time.sleep(seconds)
    now, took = server.tell()["heard"], time.monotonic() - began
    return (server.cpu_s() - cpu) / took, (load.cpu_s() - pads) / took, (now - heard) / took


def ages(chrome, seconds):
    """How old each position of a beacon was when it had been drawn, ms."""
    chrome.evaluate("window.__seen.watch(true)")
    time.sleep(seconds)
    found = chrome.evaluate("window.__seen.ages")
    chrome.evaluate("window.__seen.watch(false)")
    assert len(found) > seconds, "hardly any position was drawn"
    return found


def show_ages(title, received, drawn):
    rows = [
        (name, f"{p50(ages_ms):.0f}", f"{p95(ages_ms):.0f}", f"{max(ages_ms):.0f}")
        for name, ages_ms in (("in a console's socket", received), ("drawn", drawn))
    ]
    show(title, ("until", "p50 ms", "p95 ms", "worst ms"), rows)


def test_ingest_to_screen(tmp_path, pytestconfig, keep):
    """2,500 positions/s: what taking them in costs, and with 200 consoles how old they are on the screen."""
    consoles = pytestconfig.getoption("--consoles")
    server = Server(tmp_path / "backend", "hub", 0, "--drones", 1, "--console", built_console(), "--pads", PADS)
    load = viewers = chrome = None
    try:
        load = Load("stream", server, tmp_path / "backend", RATE)
        time.sleep(SETTLING_S)
        alone = spent(server, load, SECONDS)
        chrome = new_chrome(tmp_path / "chrome")
        viewers = Viewers(server, consoles)
        open_map(chrome, server, RATE - 100)
        time.sleep(SETTLING_S)
        viewers.ages_ms()
        drawn = ages(chrome, SECONDS)
        received = viewers.ages_ms()
        shown = spent(server, load, SECONDS)
        assert viewers.alive(), "the server closed a console"
    finally:
        for each in (viewers, chrome, load, server):
            if each is not None:
                each.close()
    assert alone[2] > 0 < shown[2], "no positions were taken in"
    rows = [
        (name, f"{rate:.0f}", f"{100 * backend:.0f} %", f"{1e6 * backend / rate:.0f}", f"{100 * pads:.0f} %")
        for name, (backend, pads, rate) in (("no console", alone), (f"{consoles} consoles and a browser", shown))
    ]
    show(
        f"{RATE:,} positions/s from {PADS} pads into SQLite",
        ("with", "taken in /s", "backend, of a core", "CPU µs a position", "the pads' pushing"),
        rows,
    )
    show_ages(f"Sent by the pad → {consoles} consoles, {len(drawn)} positions", received, drawn)
    keep(
        ingest_core=alone[0],
        ingest_core_with_consoles=shown[0],
        cpu_us_a_position=1e6 * alone[0] / alone[2],
        positions_per_s=alone[2],
        to_screen_p50_ms=p50(drawn),
        to_screen_p95_ms=p95(drawn),
        consoles=consoles,
    )


class Broadcasts(threading.Thread):
    """Drones that a receiver hears, each once a second, as bare frames in datagrams."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self._port = port
        self._ending = threading.Event()

    def run(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            number = 0
            while not self._ending.wait(1 / HEARD):
                lat_e7, lon_e7 = beacon(number, time.time_ns() // 1_000_000)
                frame = encode(
                    Pack(messages=(BasicId(uas_id=f"SE{number:04d}"), Location(lat_e7=lat_e7, lon_e7=lon_e7)))
                )
                out.sendto(frame, ("127.0.0.1", self._port))
                number = (number + 1) % HEARD

    def close(self):
        self._ending.set()
        self.join()


def test_receiver_to_map(tmp_path, keep):
    """A datagram at the pad's receiver, through its spool and uplink, the backend and the socket, to the drawn frame."""
    server = Server(tmp_path / "backend", "hub", 0, "--drones", 1, "--console", built_console(), "--pads", 1)
    load = chrome = broadcasts = viewers = None
    try:
        load = Load("receiver", server, tmp_path / "backend")
        broadcasts = Broadcasts(load.ready["port"])
        broadcasts.start()
        chrome = new_chrome(tmp_path / "chrome")
        viewers = Viewers(server, 1)
        open_map(chrome, server, HEARD)
        time.sleep(SETTLING_S)
        viewers.ages_ms()
        drawn = ages(chrome, SECONDS)
        received = viewers.ages_ms()
    finally:
        for each in (broadcasts, viewers, chrome, load, server):
            if each is not None:
                each.close()
    show_ages(f"Datagram at the receiver → the map, {HEARD} drones at 1 Hz, {len(drawn)} positions", received, drawn)
    keep(receiver_p50_ms=p50(drawn), receiver_p95_ms=p95(drawn))
