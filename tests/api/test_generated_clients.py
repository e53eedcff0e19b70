"""Clients of other languages, as docs/api/clients.md has them made: generated from what the server says of itself,
compiled, and run against it."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "clients"
MODULES = ROOT / "frontend" / "node_modules"
PAGE = (ROOT / "docs" / "api" / "clients.md").read_text()
SCOPES = "wonderland.pads.read wonderland.proofs.read wonderland.proofs.request"
TOLD = """\
pad pad-1 Aurajoki 2 commissioned
pad pad-2 Aurajoki 2 registered
session uav-2 decided refuted {refuted}
session uav-1 completed verified {verified}
request uav-1 pending
problem urn:wonderland:problem:not-found 404
"""


def commands(language):
    """The lines of the page for this language, but for the one that runs it and what `curl` gets."""
    (block,) = re.findall(rf"```sh {language}\n(.*?)```", PAGE, re.DOTALL)
    return [line for line in block.splitlines() if not line.startswith(("curl ", "cd "))]


async def run(line, directory, **environment):
    process = await asyncio.create_subprocess_shell(
        line,
        cwd=directory,
        env=os.environ | environment,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(100):
        output, errors = await process.communicate()
    assert process.returncode == 0, f"{line}\n{output.decode()[-3_000:]}\n{errors.decode()[-3_000:]}"
    return output.decode()


@pytest.fixture
async def at_work(running, register, clock, tmp_path):
    """Where the description lies, what a client needs to know, and what it should tell."""
    clock.now_ms += 60_000  # after the sessions that are there
    row, secret = await register(running, SCOPES)
    answer = await running.get("/openapi.json")
    (tmp_path / "openapi.json").write_text(answer.text)
    verdicts = {each["outcome"]: each["block"] for each in (await running.json("/verdicts"))["items"]}
    environment = {"WONDERLAND_URL": running.url, "CLIENT_ID": row.client_id, "CLIENT_SECRET": secret}
    return environment, TOLD.format(**verdicts)


@pytest.mark.skipif(shutil.which("go") is None, reason="needs Go")
async def test_go(at_work, tmp_path):
    environment, told = at_work
    shutil.copytree(EXAMPLES / "go", tmp_path, dirs_exist_ok=True)
    try:
        await run("go mod download", tmp_path, GOTOOLCHAIN="local", GOFLAGS="-mod=readonly")
    except AssertionError as error:
        pytest.skip(f"Go’s modules cannot be had here: {str(error)[-300:]}")
    said = [await run(line, tmp_path, GOTOOLCHAIN="local", **environment) for line in commands("go")]
    assert said[-1] == told


@pytest.mark.skipif(shutil.which("node") is None or not MODULES.is_dir(), reason="needs Node.js and `make setup`")
async def test_typescript(at_work, register, running, tmp_path):
    environment, told = at_work
    shutil.copytree(EXAMPLES / "typescript", tmp_path, dirs_exist_ok=True)
    (tmp_path / "node_modules").symlink_to(MODULES)
    said = [await run(line, tmp_path, **environment) for line in commands("typescript")]
    assert said[-1] == told
    row, secret = await register(running, "wonderland.pads.read")
    environment |= {"CLIENT_ID": row.client_id, "CLIENT_SECRET": secret}
    with pytest.raises(AssertionError, match="urn:wonderland:problem:insufficient-scope: The token lacks the scope"):
        await run(commands("typescript")[-1], tmp_path, **environment)


def test_what_is_generated_is_not_kept():
    ignored = (ROOT / ".gitignore").read_text().splitlines()
    assert {"examples/clients/go/wonderland/", "examples/clients/typescript/wonderland.d.ts"} <= set(ignored)
    package = json.loads((EXAMPLES / "typescript" / "package.json").read_text())
    wanted = json.loads((ROOT / "frontend" / "package.json").read_text())
    known = wanted["dependencies"] | wanted["devDependencies"]
    ours = package["dependencies"] | package["devDependencies"]
    assert ours == {name: known[name] for name in ours}, "tested with the console’s own"
