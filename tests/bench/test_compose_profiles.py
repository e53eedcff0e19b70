"""compose.yaml's three profiles: up from nothing, down, up again with what is in the volumes; seconds and memory."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from wonderland_fabric_network import binaries

ROOT = Path(__file__).parents[2]
NAMESPACES = ["unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]

pytestmark = [pytest.mark.bench, pytest.mark.timeout(600)]


@pytest.mark.parametrize("profile", ["raft", "bft", "embedded"])
def test_up_down_and_up_again(tmp_path, profile):
    if os.geteuid() != 0 or not all(map(shutil.which, ("unshare", "nsenter", "setpriv", "ip"))):
        pytest.skip("running compose.yaml's services needs root, util-linux and iproute2")
    environment = dict(os.environ)
    if profile != "embedded":
        try:
            environment["FABRIC_BIN"] = str(binaries.find_binaries()["peer"].parent)
        except binaries.BinaryError as error:
            pytest.skip(f"Fabric's servers are needed: {error}")
    script = ROOT / "tests" / "compose" / "run_profile.py"
    command = [*NAMESPACES, sys.executable, str(script), str(ROOT / "compose.yaml"), profile, str(tmp_path), "2"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["runs"]
    assert second["height"] > first["height"]
    for name, run in (("first", first), ("again", second)):
        mib = sum(run["mib"].values())
        print(
            f"{profile:<9} {name}: healthy after {run['healthy_s']} s, a landing permitted after {run['granted_s']} s, "
            f"{len(run['mib'])} containers with {mib} MiB"
        )
