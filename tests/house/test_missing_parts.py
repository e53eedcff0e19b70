"""Whoever asks for what is not installed is told what to install, in one line."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from wonderland import missing_parts

ROOT = Path(__file__).resolve().parents[2]
PROJECTS = [
    tomllib.loads(path.read_text())["project"]
    for path in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("libraries/*/pyproject.toml")]
]
WITHOUT = """
import importlib.abc, sys
class Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] == sys.argv[1]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
from wonderland.cli import main
main(sys.argv[2:])
"""
NO_PACKAGES = """
import sys
from wonderland import cli
cli.InstalledCommands._entries = lambda self: {}
cli.main(sys.argv[1:])
"""


def run(program, *arguments):
    done = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def test_the_table_is_what_the_distributions_say():
    said = {
        command: project["name"]
        for project in PROJECTS
        for command in project.get("entry-points", {}).get("wonderland.commands", {})
    }
    assert said == missing_parts.COMMANDS
    assert set(missing_parts.DEBIAN) <= {project["name"] for project in PROJECTS}


@pytest.mark.parametrize("command", sorted(missing_parts.COMMANDS))
def test_a_command_that_is_not_installed(command):
    code, said = run(NO_PACKAGES, command, "--help")
    assert (code, said.splitlines()) == (1, [f"Error: {missing_parts.of_command(command)}"])
    assert f"pip install {missing_parts.COMMANDS[command]}" in said


def test_a_command_that_there_is_not():
    code, said = run(NO_PACKAGES, "nonsense")
    assert code == 2
    assert "No such command 'nonsense'" in said


@pytest.mark.parametrize(
    ("module", "arguments", "says"),
    [
        ("httpx", ("network", "up", "--help"), "not whole; install wonderland-fabric-network anew"),
        ("wonderland_simulator", ("demo",), "pip install wonderland-simulator"),
        ("fastapi", ("backend", "serve", "--help"), "not whole; install wonderland-backend anew"),
        ("wonderland_uav_agent", ("uav", "prove"), "pip install wonderland-uav-agent"),
    ],
)
def test_a_module_that_an_extra_brings(module, arguments, says):
    code, said = run(WITHOUT, module, *arguments)
    assert code == 1, said
    assert says in said
    assert len(said.splitlines()) == 1


def test_the_command_s_own_distribution_is_named_first():
    assert "'wonderland-evidence[timestamps]'" in missing_parts.of_module("httpx", "wonderland-evidence")
    assert "'wonderland-fabric-gateway[ca]'" in missing_parts.of_module("httpx", "wonderland-fabric-gateway")
    assert "'wonderland-remote-id[drip]'" in missing_parts.of_module("Crypto.Hash", "wonderland-edge-agent")
    assert "'wonderland-fabric-gateway[hsm]'" in missing_parts.of_module("pkcs11")


def test_help_lists_what_is_whole_and_says_why_not_when_asked():
    program = WITHOUT.replace("main(sys.argv[2:])", "sys.argv[0] = 'wonderland'; main(sys.argv[2:])")
    done = subprocess.run(
        [sys.executable, "-c", program, "wonderland_uav_agent", "-v", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "\n  pad " in done.stdout
    assert "\n  uav " not in done.stdout
