"""Images for a machine where no registry of images answers: bases from root file systems that mmdebstrap makes.

They are a test's own. Fabric's servers are copied from FABRIC_BIN, PostgreSQL is Debian's with what its image's
entrypoint does (`engine._POSTGRES`); of this project there is nothing but what the Dockerfile says.
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import tarfile
from pathlib import Path

from engine import _POSTGRES

from wonderland_fabric_network.compose import IMAGES

ROOT = Path(__file__).resolve().parents[2]
PREFIX = "localhost/wonderland-test"
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "wonderland-tests"
INCLUDED = {"python": "python3,python3-venv,ca-certificates", "postgres": "postgresql"}
HERE = ("/etc/ssl/certs/ca-certificates.crt", "/etc/pip.conf", "/usr/etc/npmrc", "/root/.npmrc")
"""How this machine reaches the package index: not the image's, so they are seen by the build only."""
FABRIC = {"ca": "fabric-ca-server", "orderer": "orderer", "peer": "peer"}


class ImageError(Exception):
    """`ours`: the Dockerfile is at fault, not this machine."""

    def __init__(self, text, *, ours=False):
        super().__init__(text)
        self.ours = ours


def build(work):
    """This project's image, by buildah. Raises `ImageError`."""
    python = os.environ.get("CONTAINER_PYTHON") or _imported(
        "python", _root("python"), work, {"usr/bin/python": "python3"}
    )
    node = os.environ.get("CONTAINER_NODE") or _node(work)
    seen = [f"--volume={each}:{each}:ro" for each in HERE if Path(each).exists()]
    bases = [f"--build-arg=PYTHON_IMAGE={python}", f"--build-arg=NODE_IMAGE={node}"]
    name = f"{PREFIX}/wonderland:test"
    command = ["buildah", "bud", "--isolation=chroot", "--pull-never", "--network=host", *seen, *bases, "--tag", name]
    _run(*command, str(ROOT), ours=True)
    return name


def images(ours, profile, work):
    """Image by image of compose.yaml. Raises `ImageError`."""
    postgres = os.environ.get("CONTAINER_POSTGRES") or _postgres(work)
    found = {IMAGES["wonderland"]: ours, IMAGES["postgres"]: postgres}
    if profile != "embedded":
        found |= {IMAGES[kind]: _fabric(kind, program, work) for kind, program in FABRIC.items()}
    return found


def _root(kind):
    """A root file system, made once on this machine."""
    kept = CACHE / f"debian-12-{kind}.tar"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        here = Path("/etc/apt/sources.list.d/debian.sources")
        sources = [str(here)] if here.exists() and "bookworm" in here.read_text() else []
        made = kept.with_suffix(".new.tar")
        _run("mmdebstrap", "--variant=minbase", f"--include={INCLUDED[kind]}", "bookworm", str(made), *sources)
        made.rename(kept)
    return kept


def _imported(name, base, work, added, *changes):
    """An image of a root file system and more files: text, another file, or where a link leads."""
    path = work / f"{name}.tar"
    shutil.copy(base, path)
    with tarfile.open(path, "a") as opened:
        for target, content in added.items():
            if isinstance(content, Path):
                opened.add(content, target, filter=_root_owned)
                continue
            entry = tarfile.TarInfo(target)
            entry.mode = 0o755
            data = content if isinstance(content, bytes) else b""
            if data:
                entry.size = len(data)
            else:
                entry.type, entry.linkname = tarfile.SYMTYPE, content
            opened.addfile(entry, io.BytesIO(data))
    _run("podman", "import", "--quiet", *(f"--change={each}" for each in changes), str(path), f"{PREFIX}/{name}:test")
    path.unlink()
    return f"{PREFIX}/{name}:test"


def _root_owned(entry):
    entry.uid = entry.gid = 0
    entry.uname = entry.gname = "root"
    return entry


def _node(work):
    node, npm = shutil.which("node"), Path("/usr/lib/node_modules/npm")
    if node is None or not npm.exists():
        raise ImageError("a base with Node is made from this machine's node and npm, or named by CONTAINER_NODE")
    links = {f"usr/bin/{each}": f"../lib/node_modules/npm/bin/{each}-cli.js" for each in ("npm", "npx")}
    return _imported(
        "node", _root("python"), work, {"usr/bin/node": Path(node).resolve(), "usr/lib/node_modules/npm": npm, **links}
    )


def _postgres(work):
    script = "PATH=$(echo /usr/lib/postgresql/*/bin):$PATH\nexport PATH\n"
    text = _POSTGRES.replace("set -eu\n", f"set -eu\n{script}").replace(
        "exec postgres -c", "exec postgres -k /var/run/postgresql -c"
    )
    return _imported(
        "postgres",
        _root("postgres"),
        work,
        {"usr/local/bin/postgres-entrypoint": text.encode()},
        'ENTRYPOINT ["postgres-entrypoint"]',
        "ENV PGDATA=/var/lib/postgresql/data",
        "ENV LANG=C.UTF-8",
    )


def _fabric(kind, program, work):
    added = {f"usr/local/bin/{program}": Path(os.environ["FABRIC_BIN"]) / program}
    if kind == "peer":
        builder = "/opt/hyperledger/ccaas_builder"
        module = ROOT / "libraries" / "fabric_network" / "wonderland_fabric_network" / "builder.py"
        added[f"{builder[1:]}/builder.py"] = module
        for name in ("detect", "build", "release"):
            script = f'#!/bin/sh\nexec python3 -I -S {builder}/builder.py {name} "$@"\n'
            added[f"{builder[1:]}/bin/{name}"] = script.encode()
    return _imported(f"fabric-{kind}", _root("python"), work, added)


def _run(*command, ours=False):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ImageError(f"{' '.join(command[:4])} …: {done.stdout[-2000:]}{done.stderr[-2000:]}", ours=ours)
