"""What this is made of, for those who have to vouch for it: ``supply.py sbom DIR``, ``supply.py report``.

sbom
    CycloneDX 1.6 of what people install (requirements/run.txt, by hash) and of the console (package-lock.json).
report
    Each dependency with its licence, who keeps it, when the locked version came out, and whether there is a newer one.
    Asks the package index that pip uses; without one these columns stay empty.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import httpx
from console import FRONTEND, npm
from packages import index
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version
from pip._internal.models.index import PyPI
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "requirements" / "run.txt"
PYTHON, CONSOLE = "wonderland-python.cdx.json", "wonderland-console.cdx.json"
OLD_DAYS = 2 * 365
_LOCKED = re.compile(r"^([a-z0-9][\w.-]*)==([^\s;\\]+)", re.MULTILINE | re.IGNORECASE)
_PEP_691 = "application/vnd.pypi.simple.v1+json"


def locked() -> dict[str, str]:
    """Version by name of what `make demo` installs."""
    return {canonicalize_name(name): version for name, version in _LOCKED.findall(LOCK.read_text())}


def sbom(directory: Path) -> None:
    """Write both files. Raises `subprocess.CalledProcessError`."""
    directory.mkdir(parents=True, exist_ok=True)
    project = ROOT / "simulator" / "pyproject.toml"
    command = [sys.executable, "-m", "cyclonedx_py", "requirements", "--pyproject", str(project), "--short-PURLs"]
    command += ["--output-reproducible", "--sv", "1.6", "--of", "JSON", "-o", str(directory / PYTHON), str(LOCK)]
    subprocess.run(command, check=True, capture_output=True)
    node, _ = npm()
    command = [*node, "sbom", "--sbom-format", "cyclonedx", "--package-lock-only"]
    told = subprocess.run(command, cwd=FRONTEND, check=True, capture_output=True, text=True).stdout
    found: dict[str, Any] = json.loads(told)
    # Not by --omit dev, which leaves React out as well: tools have it for a peer.
    shipped = _in_the_browser()
    found["components"] = [each for each in found["components"] if each["bom-ref"] in shipped]
    kept = {found["metadata"]["component"]["bom-ref"], *(each["bom-ref"] for each in found["components"])}
    found["dependencies"] = [
        {**each, "dependsOn": [ref for ref in each.get("dependsOn", []) if ref in kept]}
        for each in found["dependencies"]
        if each["ref"] in kept
    ]
    # What changes from run to run says nothing of what is inside.
    found.pop("serialNumber", None)
    found["metadata"].pop("timestamp", None)
    (directory / CONSOLE).write_text(json.dumps(found, indent=2) + "\n")


def _in_the_browser() -> frozenset[str]:
    """``name@version`` of the console's packages that are no tools."""
    packages = json.loads((FRONTEND / "package-lock.json").read_text())["packages"]
    return frozenset(
        f"{path.rpartition('node_modules/')[2]}@{each['version']}"
        for path, each in packages.items()
        if path and not each.get("dev") and not each.get("devOptional")
    )


def report() -> Iterator[tuple[str, str, str, str, str, str]]:
    """(name, version, licence, keepers, released, newer) of each."""
    asked_at = index() or PyPI.simple_url
    with httpx.Client(timeout=15, follow_redirects=True) as http, ThreadPoolExecutor(8) as pool:
        names = sorted(locked().items())
        asked = pool.map(lambda each: _asked(http, asked_at, *each), names)
        for (name, version), (released, newest) in zip(names, asked, strict=True):
            licence, keepers = _said(name)
            yield name, version, licence, keepers, released, newest


def _asked(http: httpx.Client, index: str, name: str, version: str) -> tuple[str, str]:
    """When this version came out (day), and the newest one where that is another; empty where nobody answers."""
    try:
        answer = http.get(f"{index}/{name}/", headers={"Accept": _PEP_691}).raise_for_status().json()
    except (httpx.HTTPError, ValueError):
        return "", ""
    spelt = "[-_.]+".join(map(re.escape, name.split("-")))
    file = re.compile(rf"^{spelt}-{re.escape(version)}[-.]", re.IGNORECASE)
    times = [each.get("upload-time", "") for each in answer["files"] if file.match(each["filename"])]
    newest = max((each for each in map(_version, answer.get("versions", [])) if each is not None), default=None)
    return min(filter(None, times), default="")[:10], "" if newest in {None, _version(version)} else str(newest)


def _version(text: str) -> Version | None:
    try:
        found = Version(text)
    except InvalidVersion:
        return None
    return None if found.is_prerelease else found


def _said(name: str) -> tuple[str, str]:
    """Licence and keepers, as the installed package says."""
    try:
        about = metadata.metadata(name)
    except metadata.PackageNotFoundError:
        return "(not installed here)", ""
    classifiers = [each.rpartition(" :: ")[2] for each in about.get_all("Classifier", []) if each.startswith("License")]
    licence = about.get("License-Expression") or " / ".join(classifiers) or (about.get("License") or "").split("\n")[0]
    keepers = [about.get(each) for each in ("Maintainer", "Author", "Maintainer-email", "Author-email")]
    return licence[:40], next((each for each in keepers if each), "")[:50]


def show_report() -> None:
    """A table, the oldest releases marked."""
    today = datetime.now(UTC).date()
    table = Table("Package", "Version", "Licence", "Kept by", "Released", "Newer")
    for name, version, licence, keepers, released, newer in report():
        age = (today - datetime.fromisoformat(released).date()).days if released else 0
        mark = "[yellow]" if age > OLD_DAYS else ""
        table.add_row(name, version, licence, keepers, f"{mark}{released}", newer)
    Console(width=None if sys.stdout.isatty() else 200).print(table)


def main(arguments: list[str]) -> int:
    """Do what was asked; the exit code."""
    match arguments:
        case ["sbom", directory]:
            try:
                sbom(Path(directory))
            except subprocess.CalledProcessError as failed:
                print(failed.stderr, file=sys.stderr)
                return 1
            print(f"{directory}/{PYTHON}\n{directory}/{CONSOLE}")
        case ["report"]:
            show_report()
        case _:
            print(__doc__)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
