"""Every wheel as built, in environments that hold only what it says that it needs."""

from __future__ import annotations

import functools
import os
import re
import subprocess
import venv
import zipfile
from dataclasses import dataclass, field
from email.parser import HeaderParser
from importlib import metadata
from pathlib import Path

import pytest
from kit.packages import build_wheels, install_wheels
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PROJECTS = sorted(path.parent for path in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("libraries/*/pyproject.toml")])


@pytest.fixture(scope="session")
def wheels(tmp_path_factory):
    """Distribution name → wheel, of all of them."""
    if not (ROOT / "frontend" / "dist" / "index.html").exists():
        pytest.skip("the console is not built (make setup)")
    to = tmp_path_factory.mktemp("wheels")
    return {canonicalize_name(path.name.split("-")[0]): path for path in build_wheels(PROJECTS, to)}


def _requirements(wheel, extras):
    with zipfile.ZipFile(wheel) as opened:
        name = next(name for name in opened.namelist() if name.endswith(".dist-info/METADATA"))
        return _wanted(HeaderParser().parsestr(opened.read(name).decode()).get_all("Requires-Dist", []), extras)


def _wanted(lines, extras):
    for line in lines:
        requirement = Requirement(line)
        if requirement.marker is None or any(requirement.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield canonicalize_name(requirement.name), frozenset(requirement.extras)


@dataclass
class Needed:
    """What a distribution brings along, all the way down."""

    ours: set[str] = field(default_factory=set)
    others: set[str] = field(default_factory=set)


def needed_by(wheels, name, extras=()):
    """All that `pip install name[extras]` would install."""
    needed, waiting, seen = Needed(), [(name, frozenset(extras))], set()
    while waiting:
        one = waiting.pop()
        if one in seen:
            continue
        seen.add(one)
        if one[0] in wheels:
            needed.ours.add(one[0])
            waiting += _requirements(wheels[one[0]], one[1])
        else:
            needed.others.add(one[0])
            waiting += _wanted(metadata.distribution(one[0]).requires or (), one[1])
    return needed


@dataclass(frozen=True)
class Installed:
    """An environment of its own."""

    path: Path
    needed: Needed

    def start(self, *command, **options):
        """A process of its Python, away from the sources."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        return subprocess.Popen(
            [str(self.path / "bin" / command[0]), *command[1:]],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self.path,
            env=environment | {"NO_COLOR": "1"},
            **options,
        )

    def run(self, *command, timeout_s=60):
        """What it prints; its errors where it fails."""
        process = self.start(*command)
        try:
            out, err = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
        assert process.returncode == 0, f"{command}: {err[-3000:]}{out[-1000:]}"
        return out

    def python(self, program):
        """The same of a program."""
        return self.run("python", "-c", program)


@pytest.fixture(scope="session")
def install(wheels, tmp_path_factory):
    """``install("wonderland-core", "client")``: that distribution with its extras, and nothing that it does not need.

    Other people's packages are those of this environment, linked file by file, so that nothing is fetched.
    """
    made = {}

    def install(name, *extras):
        key = (name, extras)
        if key not in made:
            needed = needed_by(wheels, name, extras)
            path = tmp_path_factory.mktemp(name.replace("-", "_"))
            venv.create(path, symlinks=True, with_pip=False)
            site = next(path.glob("lib/python*/site-packages"))
            for other in needed.others:
                _link(metadata.distribution(other), site)
            install_wheels([wheels[one] for one in needed.ours], path)
            made[key] = Installed(path, needed)
        return made[key]

    return install


# Every file that is installed is looked at for it: a sixth of a second.
_owners = functools.cache(metadata.packages_distributions)


def _link(distribution, site):
    """Its files, whole folders where they are its own alone."""
    owners = _owners()
    mine = canonicalize_name(distribution.metadata["Name"])
    for file in distribution.files or ():
        top = file.parts[0]
        if top in {"..", "__pycache__"}:
            continue
        shared = len({canonicalize_name(one) for one in owners.get(re.sub(r"\..*", "", top), [mine])}) > 1
        relative = Path(*file.parts) if shared else Path(top)
        target = site / relative
        if not target.exists() and not target.is_symlink():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(Path(str(distribution.locate_file(relative))))
