"""Makes the site of the documentation from the same pages: ``documentation.py`` (``make site``; decision 0046).

It lies in site/html and needs neither a server nor a network. A warning is an error: a link that leads nowhere, a page
that the navigation lacks. The pages are copied, so that nothing is written into docs/.
"""

from __future__ import annotations

import gzip
import os
import shutil
import subprocess
import sys
import tarfile
from importlib.metadata import version
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
START: Final = "docs/README.html"
_START_PAGE: Final = f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Wonderland</title><meta http-equiv="refresh" content="0; url={START}">
<p><a href="{START}">Wonderland</a></p></html>
"""


def lay_out(to: Path) -> None:
    """Everything that git does not ignore, where it is in the repository."""
    shutil.rmtree(to, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    for name in filter(None, listed.split("\0")):
        if (source := ROOT / name).is_file():
            target = to / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)


def commit() -> str:
    """Of which commit the pages are, in short; empty where git is not at hand."""
    try:
        done = subprocess.run(
            ["git", "rev-parse", "--short=12", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


def pack(html: Path, to: Path, moment_s: int) -> None:
    """The site as one .tar.gz, its directory called like the file: the same bytes for the same pages and moment."""
    name = to.name.removesuffix(".tar.gz")
    with (
        to.open("wb") as file,
        gzip.GzipFile("", "wb", fileobj=file, mtime=moment_s) as packed,
        tarfile.open(fileobj=packed, mode="w") as archive,
    ):
        for path in sorted(filter(Path.is_file, html.rglob("*")), key=Path.as_posix):
            entry = tarfile.TarInfo(f"{name}/{path.relative_to(html).as_posix()}")
            entry.size, entry.mtime = path.stat().st_size, moment_s
            with path.open("rb") as content:
                archive.addfile(entry, content)


def build(source: Path, to: Path) -> int:
    """Sphinx's exit code."""
    doctrees = to.with_name("doctrees")
    for each in (to, doctrees):
        shutil.rmtree(each, ignore_errors=True)
    environment = {**os.environ, "WONDERLAND_VERSION": version("wonderland-core"), "WONDERLAND_COMMIT": commit()}
    command = [sys.executable, "-m", "sphinx", "--builder", "html", "--quiet", "--fail-on-warning", "--keep-going"]
    command += ["--conf-dir", str(ROOT / "docs"), "--doctree-dir", str(doctrees), "--jobs", "auto"]
    done = subprocess.run([*command, str(source), str(to)], env=environment, check=False)
    if done.returncode == 0:
        (to / "index.html").write_text(_START_PAGE)
    return done.returncode


def main(arguments: list[str]) -> int:
    """Make it in `site`, or where the argument says; the exit code."""
    site = Path(arguments[0] if arguments else ROOT / "site").resolve()
    lay_out(site / "source")
    code = build(site / "source", site / "html")
    if code == 0:
        print(f"{(site / 'html' / 'index.html').as_uri()}")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
