"""A bare Debian in a directory, and this project's packages to be installed there.

Packages are those of the directory that WONDERLAND_PACKAGES names (`make release` does), or made here: ours from the
sources, other people's from this environment, not compressed, so that nothing is fetched.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import pytest
from kit.packages import build_wheels
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PROJECTS = sorted(path.parent for path in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("libraries/*/pyproject.toml")])
INCLUDED = "python3,systemd,ca-certificates"
NAMESPACES = ["unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]
ENTER = """
mount -t proc proc "$1/proc"; mount --rbind /dev "$1/dev"; mount -t tmpfs tmpfs "$1/run"; ip link set lo up
root=$1; shift
exec chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 \
  DEBIAN_FRONTEND=noninteractive "$@"
"""


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    """Package name → .deb of this machine's architecture."""
    given = os.environ.get("WONDERLAND_PACKAGES")
    if given:
        found = Path(given).glob(f"*_{_architecture()}.deb")
    else:
        if shutil.which("dh") is None:
            pytest.skip("making Debian packages needs debhelper")
        if sys.version_info[:2] != (3, 11):
            pytest.skip("Debian 12 has Python 3.11: this environment is of another one")
        if not (ROOT / "frontend" / "dist" / "index.html").exists():
            pytest.skip("the console is not built (make setup)")
        found = _built(tmp_path_factory.mktemp("packages"))
    return {path.name.split("_")[0]: path for path in found}


def _architecture():
    return subprocess.run(["dpkg", "--print-architecture"], capture_output=True, text=True, check=True).stdout.strip()


def _built(work):
    sys.path.insert(0, str(ROOT / "scripts"))
    import debian

    ours = {canonicalize_name(path.name.split("-")[0]) for path in build_wheels(PROJECTS, work / "ours")}
    # What commissioning takes is half of all files; `make release` tries it.
    contents = {**debian.CONTENTS, "wonderland-pad": ("wonderland-edge-agent[receivers]",)}
    architecture = _architecture()
    machine = debian.MACHINES[architecture]

    def put(names, site):
        debian.install(names & ours, site, wheels=[work / "ours"], machine=machine) if names & ours else site.mkdir()
        for name in names - ours:
            for file in metadata.distribution(name).files:
                if ".." not in file.parts and "__pycache__" not in file.parts:
                    (site / file).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy(file.locate(), site / file)

    os.environ["DEB_COMPRESSION"] = "none"
    try:
        return debian.build(debian.shares(machine, contents), put, architecture, work)
    finally:
        del os.environ["DEB_COMPRESSION"]


@pytest.fixture(scope="session")
def base(tmp_path_factory):
    """A bare Debian 12 as an archive, made once on this machine."""
    if os.geteuid() != 0 or shutil.which("unshare") is None or shutil.which("ip") is None:
        pytest.skip("a Debian in a directory needs root, util-linux and iproute2")
    if subprocess.run([*NAMESPACES, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no namespaces")
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "wonderland-tests" / "debian-12.tar"
    if not cache.exists():
        if shutil.which("mmdebstrap") is None:
            pytest.skip("a bare Debian is made by mmdebstrap")
        cache.parent.mkdir(parents=True, exist_ok=True)
        made = tmp_path_factory.mktemp("base") / "debian-12.tar"
        here = Path("/etc/apt/sources.list.d/debian.sources")
        sources = [str(here)] if here.exists() and "bookworm" in here.read_text() else []
        command = ["mmdebstrap", "--variant=minbase", f"--include={INCLUDED}", "bookworm", str(made), *sources]
        if (done := subprocess.run(command, capture_output=True, text=True, check=False)).returncode:
            pytest.skip(f"no bare Debian: {done.stderr[-300:]}")
        shutil.move(made, cache)
    return cache


@dataclass(frozen=True)
class Machine:
    """A Debian in a directory."""

    root: Path

    def run(self, *command, code=0, timeout_s=120, stdin=""):
        """What it says; in namespaces of its own, without a network."""
        done = subprocess.run(
            [*NAMESPACES, "sh", "-c", ENTER, "sh", str(self.root), *command],
            input=stdin,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        assert done.returncode == code, f"{command}: {done.stdout[-3000:]}{done.stderr[-3000:]}"
        return done.stdout + done.stderr

    def files(self):
        """Everything that is there, but what dpkg, systemd and useradd write for themselves."""
        kept = ("var/lib/dpkg/", "var/log/", "var/cache/", "var/lib/systemd/", "etc/passwd", "etc/group", "tmp/")
        kept += ("etc/shadow", "etc/gshadow", "etc/.pwd.lock", "run/", "etc/subuid", "etc/subgid", "etc/ld.so.cache")
        found = (str(path.relative_to(self.root)) for path in self.root.rglob("*"))
        return {path for path in found if not path.startswith(kept) and "__pycache__" not in path}


@pytest.fixture(scope="module")
def machine(base, packages, tmp_path_factory):
    """A bare one with the packages beside it, in /tmp."""
    root = tmp_path_factory.mktemp("debian")
    subprocess.run(["tar", "--extract", "--file", str(base), "--directory", str(root)], check=True)
    for path in packages.values():
        shutil.copy(path, root / "tmp")
    return Machine(root)
