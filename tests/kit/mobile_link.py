"""A mobile link between a drone's computer and the rest: packets late, lost, gone for a while, or their path forgotten.

Two TUN devices, each in a network namespace of its own, and between them what a mobile network does to packets.
Everything above IP is the systems' own: the drone's TCP, TLS and gRPC meet what they would meet. At the near end
connections go on to a port of this machine's loopback, by a cable (`kit.cable`).
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import random
import shutil
import socket
import struct
import subprocess

import pytest

from kit.cable import Cable
from kit.sitl import own_network

HERE, THERE = "10.77.0.1", "10.77.0.2"
_SET_DEVICE, _TUN, _BARE = 0x400454CA, 0x0001, 0x1000
_TCP = 6


def _device(name):
    handle = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    fcntl.ioctl(handle, _SET_DEVICE, struct.pack("16sH14x", name.encode(), _TUN | _BARE))
    return handle


def _ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


class MobileLink:
    """`async with` it. `prefix` puts a command on the drone's side; there, `address` leads to the loopback's port."""

    def __init__(self, port, *, late_s=0.05, jitter_s=0.03, lost=0.02, seed=1):
        self._target = port
        self.address = ""
        self.late_s, self.jitter_s, self.lost = late_s, jitter_s, lost
        self.is_away = False
        self.carried = 0
        self._rng = random.Random(seed)
        self._name = f"wonderland-{os.getpid()}"
        self._seen, self._forgotten = set(), set()
        self._last_s = {}

    @property
    def prefix(self):
        return ("ip", "netns", "exec", self._name)

    async def __aenter__(self):
        if shutil.which("ip") is None or not os.access("/dev/net/tun", os.W_OK):
            pytest.skip("needs iproute2 and /dev/net/tun")
        loop = self._loop = asyncio.get_running_loop()
        async with contextlib.AsyncExitStack() as stack:
            # In a thread: namespaces are a thread's, and this one keeps its own.
            here, there, listening = await asyncio.to_thread(self._lay, stack)
            self._cable = Cable(self._target)
            await self._cable.open(sock=listening)
            stack.push_async_callback(self._cable.close)
            for source, target in ((here, there), (there, here)):
                loop.add_reader(source, self._ready, source, target, source == here)
                stack.callback(loop.remove_reader, source)
            self._open = stack.pop_all()
        return self

    async def __aexit__(self, *_):
        await self._open.aclose()

    def _lay(self, stack):
        done = subprocess.run(["ip", "netns", "add", self._name], capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"no network namespace can be made here: {done.stderr.strip()}")
        stack.callback(_ip, "netns", "del", self._name)
        with own_network():
            here, there = _device("pad0"), _device("uav0")
            for handle in (here, there):
                stack.callback(os.close, handle)
            _ip("addr", "add", HERE, "peer", THERE, "dev", "pad0")
            _ip("link", "set", "pad0", "up")
            _ip("link", "set", "uav0", "netns", self._name)
            listening = socket.create_server((HERE, 0))
            stack.callback(listening.close)
            self.address = f"{HERE}:{listening.getsockname()[1]}"
        for link in (("addr", "add", THERE, "peer", HERE, "dev", "uav0"), ("link", "set", "uav0", "up")):
            _ip("-n", self._name, *link)
        _ip("-n", self._name, "link", "set", "lo", "up")
        return here, there, listening

    def forget(self):
        """The carrier forgets the connections that there are, as when the drone is handed to another cell's gateway.

        Nobody is told: their packets go nowhere from now on, in both directions. New connections work.
        """
        self._forgotten |= self._seen

    def _ready(self, source, target, towards_drone):
        with contextlib.suppress(BlockingIOError):
            while True:
                self._pass(os.read(source, 65_536), source, target, towards_drone)

    def _pass(self, packet, source, target, towards_drone):
        if packet[0] >> 4 != 4:
            return
        ports_at = (packet[0] & 0x0F) * 4
        if packet[9] == _TCP:
            from_port, to_port = struct.unpack_from(">HH", packet, ports_at)
            drones_port = to_port if towards_drone else from_port
            self._seen.add(drones_port)
            if drones_port in self._forgotten:
                return
        if self.is_away or self._rng.random() < self.lost:
            return
        self.carried += 1
        # In order: a radio bearer repeats what was lost on the air and delivers in sequence.
        due_s = self._loop.time() + self.late_s + self._rng.random() * self.jitter_s
        self._last_s[source] = due_s = max(due_s, self._last_s.get(source, 0.0))
        self._loop.call_at(due_s, self._put, target, packet)

    def _put(self, target, packet):
        with contextlib.suppress(OSError):
            os.write(target, packet)
