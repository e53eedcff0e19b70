"""Debian packages from the wheels: ``debian.py WHEELS DIR [--architecture amd64 …]``.

One Python environment in /usr/lib/wonderland, whose parts are in four packages: the command line, and what each service
needs more. What two services need is in the command line's package. Other people's wheels come from the package index
that pip uses, by the hashes of requirements/dev.txt; those for another architecture are packed here and not run.
debhelper makes the rest, from deploy/debian. The same commit gives the same bytes.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Mapping
from email.utils import formatdate
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT: Final = Path(__file__).resolve().parent.parent
SOURCES: Final = ROOT / "deploy" / "debian"
LOCK: Final = ROOT / "requirements" / "dev.txt"
BASE: Final = "wonderland"
CONTENTS: Final = {
    BASE: (
        "wonderland-chaincode",
        "wonderland-core[client]",
        "wonderland-evidence[timestamps]",
        "wonderland-fabric-gateway[ca,embedded,hsm]",
        "wonderland-fabric-network",
        "wonderland-remote-id[drip]",
    ),
    "wonderland-backend": ("wonderland-backend",),
    "wonderland-pad": ("wonderland-edge-agent[commission,receivers]",),
    "wonderland-uav": ("wonderland-uav-agent[mavlink]",),
}
"""What each package is installed for; what these need comes along."""
MACHINES: Final = {"amd64": "x86_64", "arm64": "aarch64"}
PYTHON: Final = "3.11"
"""Debian 12's."""
SUITE: Final = "deb12"
HOME: Final = "usr/lib/wonderland"
ENVIRONMENT: Final = f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {PYTHON}\n"
LAUNCHER: Final = f"""#!/{HOME}/bin/python3
import sys
from wonderland.cli import main

sys.exit(main())
"""
NOT_OURS: Final = (
    "bogus-mail-host",
    "bogus-mail-host-in-debian-changelog",
    "custom-library-search-path",
    "embedded-library",
    "library-not-linked-against-libc",
    "unstripped-binary-or-object",
    "wrong-path-for-interpreter",
)
"""What lintian finds in other people's wheels, which are packed as they are; and that nobody is named as maintainer."""
_ENTRY: Final = re.compile(r"^([A-Za-z0-9].*?)((?: \\\n +--hash=\S+)+)$", re.MULTILINE)


class DebianError(Exception):
    """Why there are no packages."""


def closure(wanted: Iterable[str], machine: str) -> frozenset[str]:
    """Distributions that these need, all the way down, on that machine; as the installed ones say it."""
    waiting, seen = [Requirement(each) for each in wanted], set[tuple[str, str]]()
    while waiting:
        one = waiting.pop()
        name = canonicalize_name(one.name)
        for extra in ("", *sorted(one.extras)):
            if (name, extra) not in seen:
                seen.add((name, extra))
                lines = map(Requirement, metadata.requires(name) or ())
                waiting += [each for each in lines if _applies(each, machine, extra)]
    return frozenset(name for name, _ in seen)


def _applies(requirement: Requirement, machine: str, extra: str = "") -> bool:
    about = {"python_version": PYTHON, "python_full_version": f"{PYTHON}.0", "platform_machine": machine}
    return requirement.marker is None or requirement.marker.evaluate({**about, "extra": extra})


def shares(machine: str, contents: Mapping[str, Iterable[str]] = CONTENTS) -> dict[str, frozenset[str]]:
    """Distributions by package: each of them in one package."""
    needed = {package: closure(wanted, machine) for package, wanted in contents.items()}
    base, services = needed.pop(BASE), needed
    everything = sorted(set().union(*services.values()) - base)
    base |= {each for each in everything if sum(each in mine for mine in services.values()) > 1}
    return {BASE: base, **{package: mine - base for package, mine in services.items()}}


def locked(names: Iterable[str], machine: str) -> str:
    """Their entries of the lock that hold there, with hashes. Raises `DebianError`."""
    entries = {}
    for line, hashes in _ENTRY.findall(LOCK.read_text()):
        found = Requirement(line)
        if _applies(found, machine):
            entries[canonicalize_name(found.name)] = f"{found.name}{found.specifier}{hashes}\n"
    missing = sorted(set(names) - set(entries))
    if missing:
        raise DebianError(f"{LOCK.name} does not have {', '.join(missing)}: make lock")
    return "".join(entries[name] for name in sorted(names))


def fetch(names: Iterable[str], machine: str, to: Path) -> None:
    """Other people's wheels for Debian 12 on that machine. Raises `DebianError`."""
    to.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as wanted:
        wanted.write(locked(names, machine))
        wanted.flush()
        _run("pip", "download", "--require-hashes", "--no-deps", "--dest", to, *_target(machine), "-r", wanted.name)


def _target(machine: str) -> list[str]:
    platforms = [f"--platform=manylinux{tag}_{machine}" for tag in ("2014", "_2_17", "_2_28", "_2_34")]
    return ["--only-binary=:all:", "--implementation=cp", f"--python-version={PYTHON}", *platforms]


def install(names: Iterable[str], site: Path, *, wheels: Iterable[Path], machine: str) -> None:
    """Distributions from wheels in these directories, as for that machine. Raises `DebianError`."""
    links = [f"--find-links={each}" for each in wheels]
    command = ["pip", "install", "--quiet", "--no-deps", "--no-index", "--no-compile", f"--target={site}", *links]
    _run(*command, *_target(machine), *sorted(names))
    # Programs of other people's packages; the one command is the package's.
    shutil.rmtree(site / "bin", ignore_errors=True)


def _stage(package: str, root: Path) -> None:
    """What the package installs beside its distributions."""
    if package == BASE:
        _file(
            root / HOME / "pyvenv.cfg", f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {PYTHON}\n"
        )
        _file(root / HOME / "bin" / "wonderland", LAUNCHER, 0o755)
        (root / HOME / "bin" / "python3").symlink_to(f"/usr/bin/python{PYTHON}")
        (root / "usr/bin").mkdir()
        (root / "usr/bin/wonderland").symlink_to("../lib/wonderland/bin/wonderland")
        return
    name = package.removeprefix("wonderland-")
    _file(root / "etc/wonderland" / f"{name}.toml", (ROOT / "deploy/etc" / f"{name}.toml").read_text())


def _file(path: Path, text: str, mode: int = 0o644) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(mode)


def build(
    contents: Mapping[str, frozenset[str]], put: Callable[[frozenset[str], Path], None], architecture: str, work: Path
) -> list[Path]:
    """The packages of an architecture; `put` installs distributions into a directory. Raises `DebianError`."""
    tree = work / "source"
    shutil.copytree(SOURCES, tree / "debian")
    shutil.copy(ROOT / "CHANGELOG.md", tree / "debian" / "changelog.md")
    for package, names in contents.items():
        root = tree / "root" / package
        put(names, root / HOME / "lib" / f"python{PYTHON}" / "site-packages")
        _stage(package, root)
        unit = ROOT / "deploy" / "systemd" / f"{package}.service"
        if unit.exists():
            shutil.copy(unit, tree / "debian")
    _file(tree / "debian" / f"{BASE}.docs", "debian/changelog.md\n")
    version = tomllib.loads((ROOT / "libraries/core/pyproject.toml").read_text())["project"]["version"]
    maintainer = re.search(r"^Maintainer: (.*)$", (SOURCES / "control").read_text(), re.MULTILINE)
    assert maintainer is not None
    when = commit_time()
    _file(
        tree / "debian" / "changelog",
        f"wonderland ({version}-1~{SUITE}) bookworm; urgency=medium\n\n  * What changed: changelog.md of the package "
        f"wonderland.\n\n -- {maintainer[1]}  {formatdate(when)}\n",
    )
    command = [
        "dpkg-buildpackage",
        "--build=binary",
        "--no-sign",
        "--no-check-builddeps",
        f"--host-arch={architecture}",
    ]
    _run(*command, cwd=tree, environment={"SOURCE_DATE_EPOCH": str(when), "DEB_BUILD_OPTIONS": "nocheck"}, program=None)
    return sorted(work.glob("*.deb"))


def _run(
    *command: object, cwd: Path = ROOT, environment: Mapping[str, str] = {}, program: str | None = sys.executable
) -> None:
    line = [str(each) for each in ((program, "-m", *command) if program else command)]
    before = os.umask(0o022)
    try:
        done = subprocess.run(
            line, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, check=False
        )
    except FileNotFoundError as error:
        raise DebianError(f"{line[0]} is missing; Debian 12 has it: apt install dpkg-dev debhelper") from error
    finally:
        os.umask(before)
    if done.returncode:
        raise DebianError(f"{' '.join(line[:6])} …:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")


def commit_time() -> int:
    """When what is built here was committed, in seconds; SOURCE_DATE_EPOCH, where it is set, wins."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    said = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True, check=True)
    return int(said.stdout)


def main(arguments: list[str]) -> int:
    """Do what was asked; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheels", type=Path, help="directory with this project's wheels")
    parser.add_argument("to", type=Path, help="where the packages go")
    parser.add_argument("--architecture", action="append", choices=sorted(MACHINES), help="[all]")
    given = parser.parse_args(arguments)
    given.to.mkdir(parents=True, exist_ok=True)
    ours = {canonicalize_name(each.name.split("-")[0]) for each in given.wheels.glob("wonderland*.whl")}
    try:
        for architecture in given.architecture or sorted(MACHINES):
            machine = MACHINES[architecture]
            contents = shares(machine)
            with tempfile.TemporaryDirectory() as work:
                others = Path(work) / "others"
                fetch(frozenset().union(*contents.values()) - ours, machine, others)
                put = partial(install, wheels=(given.wheels.resolve(), others), machine=machine)
                for each in build(contents, put, architecture, Path(work)):
                    print(shutil.copy(each, given.to))
    except DebianError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
