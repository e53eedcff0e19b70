"""A real MQTT broker in a process of its own: mosquitto where it is installed, else, for what that can, mqttools'."""

from __future__ import annotations

import asyncio
import os
import shutil
import socket
import subprocess
import sys

import pytest


def free_port():
    """A TCP port that was free just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Broker:
    """At `port` of loopback; `tls` names its certificate's file (with key and chain) and the CA of its clients'."""

    def __init__(self, directory, *, needs_mosquitto=False, tls=None):
        self.port = free_port()
        mosquitto = os.environ.get("MOSQUITTO") or shutil.which("mosquitto") or shutil.which("/usr/sbin/mosquitto")
        if mosquitto is None and (needs_mosquitto or tls is not None):
            pytest.skip("mosquitto is not installed (Debian: mosquitto)")
        if mosquitto is not None:
            lines = [f"listener {self.port} 127.0.0.1", "allow_anonymous true"]
            if os.geteuid() == 0:
                lines.append("user root")
            if tls is not None:
                certificate, authority = tls
                lines += [f"certfile {certificate}", f"keyfile {certificate}", f"cafile {authority}"]
            config = directory / "mosquitto.conf"
            config.write_text("\n".join(lines) + "\n")
            self._command = [mosquitto, "-c", str(config)]
        else:
            program = [sys.executable, "-m", "mqttools", "broker"]
            self._command = [*program, "--host", "127.0.0.1", "--port", str(self.port)]
        self._process = None

    async def start(self):
        self._process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        async with asyncio.timeout(60):
            while True:
                try:
                    _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                except OSError:
                    assert self._process.poll() is None, "the broker ended"
                    await asyncio.sleep(0.05)
                else:
                    writer.close()
                    return

    def stop(self):
        if self._process is not None:
            self._process.kill()
            self._process.wait(10)
            self._process = None
