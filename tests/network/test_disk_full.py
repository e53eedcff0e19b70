"""A peer whose ledger's disk is full: at its start, and while it works. On a small file system of its own.

The file system is mounted in a mount namespace, in which everything of this network runs; it goes with the last process.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(180)]


class Elsewhere:
    """A mount namespace: a shell in it that runs one command after the other."""

    def __init__(self, log):
        self._log = log
        self._shell = subprocess.Popen(["unshare", "--mount", "sleep", "infinity"])

    def run(self, *command, check=True):
        inside = ["nsenter", f"--target={self._shell.pid}", "--mount", "--wd=/", *map(str, command)]
        done = subprocess.run(inside, capture_output=True, text=True, timeout=120, check=False)
        assert not check or done.returncode == 0, done.stderr
        return done

    def network(self, *arguments, check=True):
        return self.run(sys.executable, "-m", "wonderland.cli", "network", *arguments, check=check)

    def close(self):
        self._shell.kill()
        self._shell.wait()


@pytest.fixture
def elsewhere(fabric, tmp_path):
    if os.geteuid() != 0 or not shutil.which("nsenter"):
        pytest.skip("mounting a small file system needs root and util-linux")
    if subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no mount namespaces")
    place = Elsewhere(tmp_path)
    while Path(f"/proc/{place._shell.pid}/ns/mnt").stat().st_ino == Path("/proc/self/ns/mnt").stat().st_ino:
        assert place._shell.poll() is None
    yield place
    place.network("destroy", "--yes", "--dir", tmp_path / "net", check=False)
    place.close()


def _small(elsewhere, directory, size):
    elsewhere.run("mkdir", "-p", directory)
    elsewhere.run("mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", directory)


def _said(done):
    assert done.returncode == 1, done.stdout
    return " ".join(done.stderr.split())


def test_a_peer_without_room_for_its_ledger(elsewhere, tmp_path):
    net = tmp_path / "net"
    data = net / "organisations" / "PadMSP" / "nodes" / "peer0" / "data"
    _small(elsewhere, data, "16k")
    said = _said(elsewhere.network("up", "--dir", net, check=False))
    assert "PadMSP.peer0: ended while it was starting" in said
    assert "Next: its disk is full; make room, then `wonderland network up` again" in said
    elsewhere.run("umount", "--lazy", data)
    answer = json.loads(elsewhere.network("up", "--json", "--dir", net).stdout)
    assert answer["ready"] is True


def test_a_peer_whose_disk_fills_up_while_it_works(elsewhere, tmp_path):
    net = tmp_path / "net"
    data = net / "organisations" / "PadMSP" / "nodes" / "peer0" / "data"
    _small(elsewhere, data, "64m")
    elsewhere.network("up", "--dir", net)
    log = net / "logs" / "PadMSP.peer0.log"
    elsewhere.run("sh", "-c", f"dd if=/dev/zero of={data}/ballast bs=4k 2>/dev/null || true")
    filling = elsewhere.run(sys.executable, Path(__file__).parent / "fill_peer.py", net, "PadMSP.peer0", check=False)
    assert filling.returncode == 0, filling.stderr
    assert "no space left on device" in log.read_text()
    assert elsewhere.network("status", "--dir", net, check=False).returncode == 3
    said = _said(elsewhere.network("up", "--dir", net, check=False))
    assert "PadMSP.peer0" in said
    assert "Next: its disk is full; make room, then `wonderland network up` again" in said
    height = elsewhere.run("rm", data / "ballast") and None
    elsewhere.network("up", "--dir", net)
    status = json.loads(elsewhere.network("status", "--json", "--dir", net).stdout)
    assert status["healthy"] is True
    heights = {each["height"] for each in status["components"] if each["kind"] == "peer"}
    assert len(heights) == 1, height
