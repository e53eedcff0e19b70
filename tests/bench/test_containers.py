"""The image built from the Dockerfile, and compose.yaml's services as containers of podman: up, killed one by one, down.

Bases come from the images that CONTAINER_PYTHON, CONTAINER_NODE and CONTAINER_POSTGRES name, or from root file systems
that mmdebstrap makes here; Fabric's servers from FABRIC_BIN. No registry of images is asked.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from wonderland_fabric_network import binaries

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "tests" / "compose" / "run_containers.py"
TOOLS = ("podman", "buildah", "runc", "mmdebstrap")

pytestmark = [pytest.mark.bench, pytest.mark.timeout(1_500)]


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    """Its name, built from this checkout."""
    missing = [each for each in TOOLS if shutil.which(each) is None]
    if os.geteuid() != 0 or missing:
        pytest.skip(f"building and running images needs root and {', '.join(missing) or 'nothing else'}")
    sys.path.insert(0, str(SCRIPT.parent))
    import local_images

    try:
        return local_images.build(tmp_path_factory.mktemp("images"))
    except local_images.ImageError as error:
        if error.ours:
            raise
        pytest.skip(str(error))


@pytest.mark.parametrize("profile", ["embedded", "raft"])
def test_up_each_killed_and_down(image, tmp_path, profile):
    environment = dict(os.environ)
    if profile != "embedded":
        try:
            environment["FABRIC_BIN"] = str(binaries.find_binaries()["peer"].parent)
        except binaries.BinaryError as error:
            pytest.skip(f"Fabric's servers are needed: {error}")
    command = [sys.executable, str(SCRIPT), str(ROOT / "compose.yaml"), profile, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1_200, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-6_000:]
    found = json.loads(done.stdout.splitlines()[-1])
    print(json.dumps(found))
    assert found["anonymous"] == 403
    assert {"verified", "refuted"} <= set(found["outcomes"])
    killed = {name for name, each in found["killed"].items() if each["code"] == 137}
    assert killed == set(found["servers"])
    assert found["block_after"] > found["block_before"]
