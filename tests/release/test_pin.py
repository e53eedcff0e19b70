"""Digests of images are written as a registry says them, all or none."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from wonderland_fabric_network.compose import IMAGES

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import pin  # noqa: E402

DIGEST = "sha256:" + "ab" * 32


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """Copies of the two files, and a skopeo that knows what `says` tells it."""
    copies = {tmp_path / path.name: pattern for path, pattern in pin.FILES.items()}
    for path in pin.FILES:
        (tmp_path / path.name).write_text(path.read_text())
    monkeypatch.setattr(pin, "FILES", copies)
    program = tmp_path / "bin" / "skopeo"
    program.parent.mkdir()
    monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")

    def says(script):
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)

    return tmp_path, says


def test_every_image_of_others_is_found():
    found = {match["tag"] for path, pattern in pin.FILES.items() for match in pattern.finditer(path.read_text())}
    others = {each.partition("@")[0] for name, each in IMAGES.items() if name != "wonderland"}
    assert others < found
    assert {each.partition(":")[0] for each in found - others} == {"python", "node"}


def test_digests_are_written_once(checkout):
    directory, says = checkout
    says(f"echo {DIGEST}")
    for _ in range(2):
        assert pin.main() == 0
        dockerfile = (directory / "Dockerfile").read_text()
        assert dockerfile.count(f"-slim-bookworm@{DIGEST}\n") + dockerfile.count(f"-bookworm-slim@{DIGEST}\n") == 2
        assert (directory / "compose.py").read_text().count(f'@{DIGEST}"') == 4
    compiled = subprocess.run([sys.executable, "-m", "py_compile", directory / "compose.py"], check=False)
    assert compiled.returncode == 0


@pytest.mark.parametrize("script", ["echo no such host >&2; exit 1", "echo sha256:12", "echo", "echo '<html>'"])
def test_without_an_answer_nothing_is_written(checkout, script, capsys):
    directory, says = checkout
    says(f'case "$*" in *python*) {script};; *) echo {DIGEST};; esac')
    before = {path: path.read_text() for path in directory.glob("*.*")}
    assert pin.main() == 1
    assert {path: path.read_text() for path in directory.glob("*.*")} == before
    assert "Nothing was written. python:" in capsys.readouterr().err
