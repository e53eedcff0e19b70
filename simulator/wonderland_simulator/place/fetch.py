"""The package that carries the extract: fetched by pip, from whatever index pip is set up with, by its hash.

pip has no way to fetch a source package without asking its build back end for metadata, which would run the package's
code and fetch more. So pip is given a back end of ours under the name that the package asks for, without isolation.
pip checks the hash before it unpacks anything.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Final

PACKAGE: Final = "quackosm"
VERSION: Final = "0.19.0"
SDIST_SHA256: Final = "90b9888963baff37c169fc6f4eec8b07a1d68228426b7a9cabbc7a685a2fd173"
MEMBER: Final = f"{PACKAGE}-{VERSION}/tests/test_files/monaco.osm.pbf"
MEMBER_SHA256: Final = "1fdee8b72c48f932cab3aa9f1f74f87dfd954509a3b47cb932556d827189b97c"
MAX_MEMBER: Final = 4 << 20
TIMEOUT_S: Final = 120
_BACK_END: Final = '''\
"""Stands in for the package's build back end: says what pip must hear, and does nothing."""
from pathlib import Path


def get_requires_for_build_wheel(config_settings=None):
    return []


def prepare_metadata_for_build_wheel(directory, config_settings=None):
    info = Path(directory) / "{package}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\\nName: {package}\\nVersion: {version}\\n")
    (info / "WHEEL").write_text("Wheel-Version: 1.0\\nGenerator: none\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n")
    return info.name
'''


class FetchError(Exception):
    """The package cannot be had; the text says why."""


def extract_into(directory: Path) -> Path:
    """Fetch the package and take the extract out of it. Raises `FetchError`."""
    with tempfile.TemporaryDirectory(prefix="wonderland-place-") as name:
        work = Path(name)
        _download(work)
        return _taken(work / f"{PACKAGE}-{VERSION}.tar.gz", directory)


def _download(work: Path) -> None:
    stand_in = work / "back_end" / "pdm"
    stand_in.mkdir(parents=True)
    (stand_in / "__init__.py").touch()
    (stand_in / "backend.py").write_text(_BACK_END.format(package=PACKAGE, version=VERSION))
    wanted = work / "requirements.txt"
    wanted.write_text(f"{PACKAGE}=={VERSION} --hash=sha256:{SDIST_SHA256}\n")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-input"]
    command += ["--require-hashes", "--no-deps", "--no-build-isolation", "--no-binary", PACKAGE]
    command += ["--retries", "1", "--timeout", "15", "--dest", str(work), "--requirement", str(wanted)]
    environment = {**os.environ, "PYTHONPATH": str(stand_in.parent)}
    try:
        done = subprocess.run(  # noqa: S603 - our own arguments
            command, capture_output=True, text=True, env=environment, cwd=work, timeout=TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as cause:
        raise FetchError(f"pip did not fetch {PACKAGE} {VERSION} ({type(cause).__name__})") from cause
    if done.returncode != 0:
        lines = [line for line in done.stderr.strip().splitlines() if line.startswith("ERROR")]
        raise FetchError(f"pip did not fetch {PACKAGE} {VERSION}: {(lines or ['no reason given'])[-1][:200]}")


def _taken(package: Path, directory: Path) -> Path:
    try:
        with tarfile.open(package) as bundle:
            member = bundle.getmember(MEMBER)
            stream = bundle.extractfile(member)
            if stream is None or member.size > MAX_MEMBER:
                raise FetchError(f"{MEMBER} in the package is no file of a sensible size")
            data = stream.read()
    except (OSError, KeyError, tarfile.TarError) as cause:
        raise FetchError(f"the package {PACKAGE} {VERSION} cannot be read ({cause})") from cause
    if hashlib.sha256(data).hexdigest() != MEMBER_SHA256:
        raise FetchError("the extract in the package is not the one that was checked")
    target = directory / "monaco.osm.pbf"
    target.write_bytes(data)
    return target
