"""A Chromium to measure in: driven over its DevTools socket with as little as there is to drive.

Playwright listens to the network of the page and its workers: each frame of a WebSocket goes once more through the
browser to its driver. With tens of megabytes a second, that takes a third of a core from what is to be measured.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import subprocess
import time

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

STARTUP_S = 30.0
CALL_S = 60.0
POLL_S = 0.1


class Chrome:
    """One page in a browser of its own."""

    def __init__(self, program, directory, *flags, width=1280, height=720):
        directory.mkdir(parents=True, exist_ok=True)
        command = [
            program,
            "--headless",
            "--remote-debugging-port=0",
            f"--user-data-dir={directory}",
            f"--window-size={width},{height}",
            "--hide-scrollbars",
            "--mute-audio",
            *flags,
            "about:blank",
        ]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._numbers = itertools.count(1)
        self._open_sockets = contextlib.ExitStack()
        try:
            self._socket = self._open(directory / "DevToolsActivePort")
            target = next(each for each in self.call("Target.getTargets")["targetInfos"] if each["type"] == "page")[
                "targetId"
            ]
            self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            self.call("Page.enable")
            self.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
        except BaseException:
            self.close()
            raise

    _session = None
    _socket = None

    def _open(self, port_file):
        ends = time.monotonic() + STARTUP_S
        while time.monotonic() < ends:
            assert self.process.poll() is None, "Chromium ended at once"
            if port_file.is_file() and len(lines := port_file.read_text().splitlines()) == 2:
                address = f"ws://127.0.0.1:{lines[0]}{lines[1]}"
                return self._open_sockets.enter_context(connect(address, max_size=None, compression=None, proxy=None))
            time.sleep(POLL_S)
        raise TimeoutError("Chromium opened no DevTools socket")

    def call(self, method, **parameters):
        """One command; events that come meanwhile are left out."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=CALL_S))
            if answer.get("id") == number:
                assert "error" not in answer, (method, answer)
                return answer["result"]

    def before_pages(self, script):
        """Runs in each page before its own scripts."""
        self.call("Page.addScriptToEvaluateOnNewDocument", source=script)

    def goto(self, url):
        self.call("Page.navigate", url=url)

    def evaluate(self, expression):
        """The value of an expression; a promise's is waited for."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, expression, timeout_s=60.0):
        """Until it is true."""
        ends = time.monotonic() + timeout_s
        while time.monotonic() < ends:
            # A page that is just going away has nothing to say.
            with contextlib.suppress(AssertionError):
                if self.evaluate(expression):
                    return
            time.sleep(POLL_S)
        raise TimeoutError(f"the page did not come to: {expression}")

    def close(self):
        if self._socket is not None:
            self._session = None
            with contextlib.suppress(AssertionError, OSError, TimeoutError, WebSocketException):
                self.call("Browser.close")
        with contextlib.suppress(OSError, WebSocketException):
            self._open_sockets.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
