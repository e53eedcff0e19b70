"""The official Node client: where it comes from, and how a test drives it."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import hashlib
import itertools
import json
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import grpc
import pytest

from kit.scenario_world import People, Person
from wonderland.proofs import encoding
from wonderland_fabric_gateway.gateway import (
    CommitStatus,
    EndorseError,
    ErrorDetail,
    EvaluateError,
    GatewayError,
    SubmitError,
)

HERE = Path(__file__).parent.parent / "node_gateway"
OLDEST_NODE = (20, 19)
KINDS = {"EndorseError": EndorseError, "SubmitError": SubmitError}


def program():
    """The node program, with the client installed beside it; skips with the reason where that cannot be."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("Node.js and npm are not installed; the official client cannot be run")
    version = subprocess.run([node, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    if tuple(int(part) for part in version.removeprefix("v").split(".")[:2]) < OLDEST_NODE:
        pytest.skip(f"Node.js {version} is older than {'.'.join(map(str, OLDEST_NODE))}, which the client needs")
    with (HERE / ".installing").open("w") as lock:  # tests in several processes want it at once
        fcntl.flock(lock, fcntl.LOCK_EX)
        _install(npm)
    return node


def _install(npm):
    wanted = hashlib.sha256((HERE / "package-lock.json").read_bytes()).hexdigest()
    stamp = HERE / "node_modules" / ".installed"
    if stamp.exists() and stamp.read_text() == wanted:
        return
    try:
        done = subprocess.run(
            [npm, "ci", "--ignore-scripts"], cwd=HERE, capture_output=True, text=True, timeout=240, check=False
        )
    except subprocess.TimeoutExpired:
        pytest.skip("npm ci did not finish within 240 s; is there a registry?")
    if done.returncode:
        pytest.skip(f"npm ci could not install the official client: {done.stderr.strip()[-300:]}")
    stamp.write_text(wanted)


class Bridge:
    """A Node process that does what it is told, one line each."""

    def __init__(self, process):
        self._process = process
        self._ids = itertools.count()
        self._waiting = {}
        self._reader = asyncio.create_task(self._read())
        self.behind_ms = 0

    @classmethod
    async def start(cls, connection_file):
        return cls(
            await asyncio.create_subprocess_exec(
                program(),
                HERE / "bridge.mjs",
                connection_file,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=32 << 20,
            )
        )

    async def close(self):
        self._process.stdin.close()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), 20)
        if self._process.returncode is None:
            self._process.kill()
            await self._process.wait()
        await self._reader

    async def ask(self, op, **fields):
        """The answer; the client's errors as those of our own client."""
        request_id = next(self._ids)
        self._waiting[request_id] = asyncio.get_running_loop().create_future()
        line = json.dumps({"id": request_id, "op": op, "behindMs": self.behind_ms, **fields})
        self._process.stdin.write(line.encode() + b"\n")
        try:
            answer = await asyncio.wait_for(self._waiting[request_id], 60)
        finally:
            del self._waiting[request_id]
        if "error" in answer:
            raise _error(op, answer["error"])
        return answer["result"]

    async def _read(self):
        while line := await self._process.stdout.readline():
            answer = json.loads(line)
            waiting = self._waiting.get(answer["id"])
            if waiting is not None and not waiting.done():
                waiting.set_result(answer)
        for waiting in self._waiting.values():
            if not waiting.done():
                waiting.set_exception(AssertionError("the Node process ended"))


class NodeError(GatewayError):
    """An error of the official client that has no counterpart of the same name."""

    operation = "node"


def _error(op, found):
    code = next((each for each in grpc.StatusCode if each.value[0] == found["grpcCode"]), None)
    details = tuple(ErrorDetail(each["address"], each["mspId"], each["message"]) for each in found["details"])
    kind = EvaluateError if op == "evaluate" else KINDS.get(found["name"], NodeError)
    error = kind(found["message"], tx_id=found["txId"], status_code=code, details=details)
    error.node_name, error.node_code = found["name"], found["grpcCode"]
    return error


@dataclass
class NodeTransaction:
    """Endorsed, submitted, and asked about; the object itself is in the Node process."""

    bridge: Bridge
    tx_id: str
    payload: bytes

    async def submit(self):
        await self.bridge.ask("submit", txId=self.tx_id)
        return self

    async def status(self):
        found = await self.bridge.ask("status", txId=self.tx_id)
        status = CommitStatus(self.tx_id, found["code"], found["blockNumber"])
        assert found["successful"] == status.is_valid
        return status


class NodePerson(Person):
    """Somebody who uses the official Node client."""

    def _ask(self, op, function, argument, endorsed_by, fields):
        bridge = self.people.bridge
        bridge.behind_ms = self.people.behind_ms
        text = encoding.encode({**(argument or {}), **fields}).decode()
        return bridge.ask(op, who=self.name, name=function, argument=text, endorsedBy=list(endorsed_by))

    async def endorsed(self, function, argument=None, /, *, endorsed_by=(), **fields):
        found = await self._ask("endorse", function, argument, endorsed_by, fields)
        return NodeTransaction(self.people.bridge, found["txId"], found["payload"].encode())

    async def submitted(self, function, argument=None, /, *, endorsed_by=(), **fields):
        transaction = await self.endorsed(function, argument, endorsed_by=endorsed_by, **fields)
        status = await (await transaction.submit()).status()
        await self.people.everywhere(status.block_number)
        status.require_valid()
        return status, encoding.decode(transaction.payload)

    async def query(self, function, argument=None, /, **fields):
        found = await self._ask("evaluate", function, argument, (), fields)
        return encoding.decode(found["payload"].encode(), max_bytes=8 << 20)


class NodePeople(People):
    """The same people, over one Node process."""

    person = NodePerson
    bridge: Bridge
