"""Every example runs as it stands, and says what it says it would."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
WONDERLAND = Path(sys.executable).with_name("wonderland")


def run(name, directory):
    done = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / f"{name}.py"],
        cwd=directory,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("own_ranges", "the truth: verified"),
        ("own_ranges", "3 m further east: refuted"),
        ("attack", "assurance 2: 0 of 100 permissions won"),
        ("remote_id", "53 bytes: f219"),
        ("remote_id", "uas_id='1581F5FKD229400A1234'"),
        ("uwb_node", "DeviceStatus(state=1)"),
    ],
)
def test_it_says(name, says, tmp_path):
    assert says in run(name, tmp_path)


def test_the_client_asks_a_ledger_and_hears_its_events(tmp_path):
    start = [WONDERLAND, "ledger", "start", "--data", tmp_path / "ledger", "--listen", "127.0.0.1:0", "--json"]
    where = tmp_path / "ledger" / "connection.json"
    with subprocess.Popen(start, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as ledger:
        try:
            assert ledger.stdout.readline(), ledger.stderr.read().decode()
            add = [
                WONDERLAND,
                "registry",
                "drones",
                "add",
                "--uav-id",
                "D-1",
                "--model",
                "Owl",
                "--operator-id",
                "op-7",
            ]
            subprocess.run(
                [*add, "--connection", where, "--identity", "fleet_operator"], check=True, capture_output=True
            )
            client = [sys.executable, "-W", "error", EXAMPLES / "fabric_client.py", where, "mirror"]
            with subprocess.Popen(client, stdout=subprocess.PIPE, text=True, env=os.environ) as process:
                try:
                    assert "buffer_mm" in process.stdout.readline()
                    assert re.fullmatch(r"\d+ \w+ [0-9a-f]{64}\n", process.stdout.readline())
                finally:
                    process.kill()
        finally:
            ledger.terminate()


def test_the_page_lists_them_all():
    page = (EXAMPLES / "README.md").read_text()
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(re.findall(r"\]\((\w+\.py)\)", page))


def test_the_supported_api_is_there():
    page = (EXAMPLES.parent / "docs" / "reference" / "python.md").read_text()
    named = re.findall(r"^\| `from ([\w.]+) import ([\w, ]+)`", page, re.MULTILINE)
    assert len(named) > 5
    for module, names in named:
        for name in names.split(", "):
            assert hasattr(importlib.import_module(module), name), f"{module}.{name}"
