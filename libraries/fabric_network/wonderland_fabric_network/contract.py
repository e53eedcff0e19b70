"""The package by which organisations agree on a contract that each of them runs as a service.

A package of type ccaas carries no code, only how a peer reaches the server. Ours carries the contract's name, version
and the digest of its source, so that what the organisations approve is a certain code; and no address, so that all of
them get the same package id. Equal input gives equal bytes (the id is their digest).
"""

from __future__ import annotations

import gzip
import hashlib
import importlib
import io
import json
import tarfile
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.embedded.contracts import GROUP, load_contract
from wonderland_fabric_network.errors import DescriptionError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

SLOTS: Final = ("a", "b")
"""A new version runs beside the one it replaces: which of an organisation's two servers a package is for."""
_RULES: Final = "wonderland.proofs"
"""What every contract here decides by; part of what is agreed on."""
_MODE: Final = 0o100644


@dataclass(frozen=True)
class InstalledContract:
    """A contract as it is installed here. `sha256` is over its source files."""

    package: str
    version: str
    sha256: str


@dataclass(frozen=True)
class ContractPackage:
    """A chaincode package: its bytes, and the id under which a peer knows it."""

    label: str
    slot: str
    version: str
    data: bytes

    @property
    def package_id(self) -> str:
        """Label ":" SHA-256 of the bytes."""
        return f"{self.label}:{hashlib.sha256(self.data).hexdigest()}"


@cache
def installed_contract(package: str) -> InstalledContract:
    """The contract of that entry point, as it was when first asked for. Raises `ContractLoadError`."""
    contract = load_contract(package)
    (entry,) = entry_points(group=GROUP, name=package)
    return InstalledContract(package, contract.version, source_digest((entry.module, _RULES)))


def source_digest(modules: Sequence[str]) -> str:
    """Lower-case hex SHA-256 over names and contents of the Python files of packages (or modules)."""
    digest = hashlib.sha256()
    for name in modules:
        found = getattr(importlib.import_module(name), "__file__", None)
        if not found:
            raise DescriptionError(f"contract: module {name} has no source files; install it from its package")
        path = Path(found)
        root = path.parent
        files: Iterable[Path] = root.rglob("*.py") if path.name == "__init__.py" else [path]
        for file in sorted(files):
            line = f"{name}/{file.relative_to(root).as_posix()} {hashlib.sha256(file.read_bytes()).hexdigest()}\n"
            digest.update(line.encode())
    return digest.hexdigest()


def build_package(name: str, contract: InstalledContract, slot: str) -> ContractPackage:
    """The package for a contract and one of the two servers of each organisation."""
    label = f"{name}_{contract.version}"
    connection = {
        "address": f"{{{{.address_{slot}}}}}",
        "dial_timeout": "10s",
        "tls_required": True,
        "client_auth_required": True,
        "client_cert": "{{.client_cert}}",
        "client_key": "{{.client_key}}",
        "root_cert": "{{.root_cert}}",
    }
    manifest = {"contract": contract.package, "version": contract.version, "sha256": contract.sha256}
    code = _archive([("connection.json", _json(connection)), ("contract.json", _json(manifest))])
    metadata = _json({"path": "", "type": "ccaas", "label": label})
    return ContractPackage(
        label, slot, contract.version, _archive([("metadata.json", metadata), ("code.tar.gz", code)])
    )


def _json(document: dict[str, Any]) -> bytes:
    return json.dumps(document, sort_keys=True, separators=(",", ":")).encode()


def _archive(files: Sequence[tuple[str, bytes]]) -> bytes:
    """A gzipped tar without times, owners and file name, so that equal files give equal bytes."""
    out = io.BytesIO()
    with (
        gzip.GzipFile(fileobj=out, mode="wb", mtime=0, filename="") as zipped,
        tarfile.open(fileobj=zipped, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name, data in files:
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            entry.mode = _MODE
            tar.addfile(entry, io.BytesIO(data))
    return out.getvalue()
