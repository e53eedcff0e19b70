"""What a release is: ``release.py DIST``. Wheels, sdists, Debian packages, SBOMs, documentation, sums, a signature.

    WONDERLAND_RELEASE_KEY=FINGERPRINT    the GnuPG key that signs; without it nothing is signed, and that is said

The same commit gives the same bytes (but for the signature). What was made is checked before it is said to be there:
names, versions, a wheel from each sdist, sums, the signature, lintian where it is installed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Final

import debian
import documentation
import supply

ROOT: Final = Path(__file__).resolve().parent.parent
PROJECTS: Final = sorted(
    path.parent for path in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("libraries/*/pyproject.toml")]
)
KEY: Final = "WONDERLAND_RELEASE_KEY"
SUMS: Final = "SHA256SUMS"
NOTES: Final = "CHANGELOG.md"


class ReleaseError(Exception):
    """Why there is no release."""


def wheels_and_sdists(to: Path) -> None:
    """Of each distribution both; each sdist makes the wheel's bytes again. Raises `ReleaseError`."""
    for project in PROJECTS:
        _run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-t", "wheel", "-d", str(to), cwd=project)
    sdists = sorted(to.glob("*.tar.gz"))
    if len(sdists) != len(PROJECTS):
        raise ReleaseError(f"{len(sdists)} sdists of {len(PROJECTS)} distributions")
    with tempfile.TemporaryDirectory() as again:
        pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index", "--no-build-isolation")
        _run(*pip, "--wheel-dir", again, *map(str, sdists))
        for wheel in to.glob("*.whl"):
            if (Path(again) / wheel.name).read_bytes() != wheel.read_bytes():
                raise ReleaseError(f"{wheel.name} is another one when it is made from its sdist")


def packages(to: Path) -> None:
    """Debian packages; lintian's errors are errors. Raises `ReleaseError`."""
    if debian.main([str(to), str(to)]):
        raise ReleaseError("no Debian packages")
    if shutil.which("lintian"):
        found = sorted(map(str, to.glob("*.deb")))
        _run("lintian", "--fail-on", "error", "--suppress-tags", ",".join(debian.NOT_OURS), *found)


def site(to: Path, version: str) -> None:
    """The documentation, as one archive. Raises `ReleaseError`."""
    with tempfile.TemporaryDirectory() as made:
        if documentation.main([made]):
            raise ReleaseError("no documentation")
        archive = to / f"wonderland-documentation-{version}.tar.gz"
        documentation.pack(Path(made) / "html", archive, debian.commit_time())


def sums(to: Path) -> Path:
    """`SHA256SUMS`, as sha256sum(1) reads it."""
    path = to / SUMS
    names = sorted(each.name for each in to.iterdir() if each.is_file() and not each.name.startswith(SUMS))
    path.write_text("".join(f"{hashlib.sha256((to / each).read_bytes()).hexdigest()}  {each}\n" for each in names))
    return path


def sign(path: Path) -> Path | None:
    """A detached signature, checked; None where nobody said with which key. Raises `ReleaseError`."""
    key = os.environ.get(KEY)
    if not key:
        return None
    signature = path.with_name(f"{path.name}.asc")
    _run(
        "gpg",
        "--batch",
        "--yes",
        "--local-user",
        key,
        "--armor",
        "--output",
        str(signature),
        "--detach-sign",
        str(path),
    )
    _run("gpg", "--batch", "--verify", str(signature), str(path))
    return signature


def check_versions() -> str:
    """The one version of all. Raises `ReleaseError`."""
    found = {tomllib.loads((each / "pyproject.toml").read_text())["project"]["version"] for each in PROJECTS}
    if len(found) != 1:
        raise ReleaseError(f"distributions have different versions: {', '.join(sorted(found))}")
    (version,) = found
    if f"## [{version}]" not in (ROOT / NOTES).read_text():
        print(f"{NOTES} has no section {version} yet: this is a rehearsal")
    return version


def _run(*command: str, cwd: Path = ROOT) -> None:
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(debian.commit_time())}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ReleaseError(f"{' '.join(command[:6])} …:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")


def main(arguments: list[str]) -> int:
    """Make all of it; the exit code."""
    if len(arguments) != 1:
        print(__doc__)
        return 2
    to = Path(arguments[0]).resolve()
    os.umask(0o022)
    try:
        version = check_versions()
        shutil.rmtree(to, ignore_errors=True)
        to.mkdir(parents=True)
        wheels_and_sdists(to)
        packages(to)
        supply.sbom(to)
        site(to, version)
        shutil.copy(ROOT / NOTES, to)
        signature = sign(sums(to))
    except (ReleaseError, debian.DebianError, subprocess.CalledProcessError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"Wonderland {version}: {len(list(to.iterdir()))} files in {to}")
    print(f"Signed: {signature.name}" if signature else f"Not signed: {KEY} names no key")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
