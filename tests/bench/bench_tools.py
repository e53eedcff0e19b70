"""Statistics, tables and the official Node client on a leash."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path

from wonderland_fabric_gateway.blocks import parse_block


def quantile(values, share):
    """The value below which ``share`` of the values lie (nearest rank)."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def p50(values):
    return quantile(values, 0.5)


def p95(values):
    return quantile(values, 0.95)


def show(title, header, rows):
    """A table for people, with how busy the machine was: a run beside other work says little."""
    cells = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    print(f"\n{title} [load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores]")
    for number, row in enumerate(cells):
        print("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        if number == 0:
            print("  " + "  ".join("-" * width for width in widths))


def node_modules():
    """A directory whose ``node_modules`` has the official client, or None. WONDERLAND_NODE names another one."""
    candidates = [os.environ.get("WONDERLAND_NODE", ""), str(Path(__file__).parent.parent / "node_gateway")]
    for each in filter(None, candidates):
        if (Path(each) / "node_modules" / "@hyperledger" / "fabric-gateway").is_dir():
            return Path(each)
    return None


class NodeClient:
    """The official client in a process: submits one transaction after the other."""

    def __init__(self, process):
        self._process = process

    async def read(self):
        line = await self._process.stdout.readline()
        assert line, "the official client ended"
        return json.loads(line)

    async def submit(self, function, arguments):
        """Milliseconds from Endorse to VALID of each; ``arguments`` are JSON texts."""
        work = {"function": function, "arguments": [each.decode() for each in arguments]}
        self._process.stdin.write(json.dumps(work).encode() + b"\n")
        await self._process.stdin.drain()
        return (await self.read())["took_ms"]


class Replay:
    """The blocks' bytes as a source; they are parsed as they would be when they come from a ledger."""

    def __init__(self, blocks):
        self._blocks = blocks

    async def height(self):
        return len(self._blocks)

    async def blocks(self, start):
        for raw in self._blocks[start:]:
            yield parse_block(raw)
        await asyncio.Event().wait()
