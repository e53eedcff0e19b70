"""Child processes that end with their parent: started, waited for, stopped by pid, none left behind."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import json
import secrets
import signal
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from wonderland_fabric_network.ports import FREE_RANGE

STOP_S: Final = 6.0
READY_LINE_BYTES: Final = 1 << 16
_PR_SET_PDEATHSIG: Final = 1
_LIBC: Final = ctypes.CDLL(None, use_errno=True)


class ProcessError(Exception):
    """A child that did not start or ended by itself; the text has its last words."""


def _die_with_parent() -> None:
    """Runs in the child before its program: the kernel ends it when the parent dies, even by kill −9."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@dataclass
class Process:
    """One child."""

    name: str
    handle: asyncio.subprocess.Process
    log: Path
    ready: dict[str, Any]

    @property
    def running(self) -> bool:
        """Whether it still runs."""
        return self.handle.returncode is None

    def last_words(self, lines: int = 12) -> str:
        """The end of its log."""
        with contextlib.suppress(OSError):
            return "\n".join(self.log.read_text(errors="replace").splitlines()[-lines:])
        return ""


class Processes:
    """The children of one run; leave the context and all are gone."""

    def __init__(self, directory: Path) -> None:
        self._logs = directory / "logs"
        self._children: list[Process] = []
        self._tasks: set[asyncio.Future[None]] = set()

    async def __aenter__(self) -> Self:
        self._logs.mkdir(parents=True, exist_ok=True, mode=0o700)
        return self

    async def __aexit__(self, *error: object) -> None:
        # In the opposite order of their start, so that what others lean on stays until they have ended.
        for child in reversed(self._children):
            await self.stop(child)

    async def start(self, name: str, *arguments: str, module: str = "wonderland.cli", ready_s: float = 30.0) -> Process:
        """Run a module with arguments; returns once it has said by one line of JSON that it is ready.

        Raises ProcessError with the end of its log when it ends before, or says nothing in ``ready_s`` seconds.
        """
        log = self._logs / f"{name}.log"
        with log.open("ab") as sink:
            handle = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                module,
                *arguments,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=sink,
                preexec_fn=_die_with_parent,
                start_new_session=True,  # Ctrl-C goes to the parent alone, which ends the children in order
                limit=READY_LINE_BYTES,
            )
        child = Process(name, handle, log, {})
        self._children.append(child)
        await self._wait_ready(child, ready_s)
        self._drain(child)
        return child

    async def _wait_ready(self, child: Process, ready_s: float) -> None:
        assert child.handle.stdout is not None
        try:
            async with asyncio.timeout(ready_s):
                while line := await child.handle.stdout.readline():
                    with contextlib.suppress(ValueError):
                        value = json.loads(line)
                        if isinstance(value, dict) and value.get("ready"):
                            child.ready = value
                            return
        except TimeoutError:
            raise ProcessError(f"{child.name} was not ready after {ready_s:.0f} s.\n{child.last_words()}") from None
        await child.handle.wait()
        raise ProcessError(f"{child.name} ended at once (code {child.handle.returncode}).\n{child.last_words()}")

    def _drain(self, child: Process) -> None:
        """What it goes on to print must not fill the pipe and stop it."""
        reader = child.handle.stdout

        async def drain() -> None:
            assert reader is not None
            with contextlib.suppress(ValueError, OSError):
                while await reader.read(1 << 16):
                    pass

        task = asyncio.ensure_future(drain())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def stop(self, child: Process) -> None:
        """Ask it to end, then insist."""
        if not child.running:
            return
        for request, patience in ((signal.SIGTERM, STOP_S), (signal.SIGKILL, 2.0)):
            with contextlib.suppress(ProcessLookupError):
                child.handle.send_signal(request)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(child.handle.wait(), patience)
                return

    def named(self, name: str) -> Process:
        """The child that was started under this name last; raises ProcessError where there is none."""
        for child in reversed(self._children):
            if child.name == name:
                return child
        raise ProcessError(f"no process {name} was started")

    def ended(self) -> Process | None:
        """A child that ended by itself, if one did."""
        return next((child for child in self._children if not child.running), None)


class PortClaims:
    """UDP ports of loopback for programs that are started later; nobody else takes them until these claims are closed.

    They lie below the range that systems give to whoever asks for any port, and on each its TCP twin is held: so two
    stages that start at the same moment do not choose the same.
    """

    def __init__(self) -> None:
        self._twins: list[socket.socket] = []

    def claim(self, count: int) -> list[int]:
        """So many ports. Raises `ProcessError` where there are not as many."""
        chosen: list[int] = []
        everything = range(*FREE_RANGE)
        for port in secrets.SystemRandom().sample(everything, k=len(everything)):
            twin = _bound(port, socket.SOCK_STREAM)
            if twin is None:
                continue
            self._twins.append(twin)
            if (probe := _bound(port, socket.SOCK_DGRAM)) is not None:
                probe.close()
                chosen.append(port)
            if len(chosen) == count:
                return chosen
        raise ProcessError(f"127.0.0.1 has no {count} free UDP ports between {FREE_RANGE[0]} and {FREE_RANGE[1]}")

    def close(self) -> None:
        """Give them all back."""
        for twin in self._twins:
            twin.close()
        self._twins.clear()


def _bound(port: int, kind: socket.SocketKind) -> socket.socket | None:
    """A socket on this port of loopback; None where it is taken."""
    found = socket.socket(socket.AF_INET, kind)
    try:
        found.bind(("127.0.0.1", port))
    except OSError:
        found.close()
        return None
    return found
