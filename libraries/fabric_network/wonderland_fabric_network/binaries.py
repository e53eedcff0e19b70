"""Fabric's servers: found in FABRIC_BIN, then on PATH, and checked to be of a version that does."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network.errors import BinaryError

if TYPE_CHECKING:
    from collections.abc import Mapping

VARIABLE: Final = "FABRIC_BIN"
SERVERS: Final[dict[str, tuple[int, int]]] = {"peer": (3, 1), "orderer": (3, 1), "fabric-ca-server": (1, 5)}
"""The oldest version of each that does."""
WHERE: Final = (
    "Fabric's releases have them: https://github.com/hyperledger/fabric/releases (peer, orderer) and "
    "https://github.com/hyperledger/fabric-ca/releases (fabric-ca-server); unpack them and set FABRIC_BIN to their "
    "directory"
)
_VERSION: Final = re.compile(r"^\s*Version:\s*v?(\S+)", re.MULTILINE)
_TIMEOUT_S: Final = 20.0
_MAX_OUTPUT: Final = 65_536


@dataclass(frozen=True)
class Binaries:
    """The servers' files."""

    peer: Path
    orderer: Path
    ca_server: Path
    versions: Mapping[str, str]


BY_NAME: Final = Binaries(Path("peer"), Path("orderer"), Path("fabric-ca-server"), {})
"""The servers as Fabric's images have them: on PATH."""


def find_binaries(environment: Mapping[str, str] | None = None) -> dict[str, Path]:
    """The servers' files, not yet run. Raises `BinaryError`, naming all that are missing and where to get them."""
    environment = os.environ if environment is None else environment
    directory = environment.get(VARIABLE, "")
    search = [directory] if directory else []
    search.append(environment.get("PATH", os.defpath))
    found = {name: shutil.which(name, path=os.pathsep.join(search)) for name in SERVERS}
    missing = [name for name, path in found.items() if path is None]
    if missing:
        looked = f"{VARIABLE}={directory}, then on PATH" if directory else f"PATH ({VARIABLE} is not set)"
        raise BinaryError(f"{', '.join(missing)} not found: looked in {looked}. {WHERE}")
    return {name: Path(path).absolute() for name, path in found.items() if path is not None}


async def check_binaries(environment: Mapping[str, str] | None = None) -> Binaries:
    """The servers, each asked for its version. Raises `BinaryError`."""
    files = find_binaries(environment)
    versions = await asyncio.gather(*(_version(name, path) for name, path in files.items()))
    for (name, path), version in zip(files.items(), versions, strict=True):
        require_version(name, path, version)
    return Binaries(files["peer"], files["orderer"], files["fabric-ca-server"], dict(zip(files, versions, strict=True)))


def require_version(name: str, path: Path, version: str) -> None:
    """Raise `BinaryError` unless a version does. One that was built from source says "latest": that is let pass."""
    numbers = re.match(r"(\d+)\.(\d+)", version)
    if numbers is None:
        return
    oldest = SERVERS[name]
    have = (int(numbers[1]), int(numbers[2]))
    if have < oldest or have[0] != oldest[0]:
        raise BinaryError(
            f"{path} is version {version}; needed is {oldest[0]}.{oldest[1]} or a later {oldest[0]}.x. {WHERE}"
        )


async def _version(name: str, path: Path) -> str:
    try:
        child = await asyncio.create_subprocess_exec(
            str(path),
            "version",
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        try:
            async with asyncio.timeout(_TIMEOUT_S):
                output, _ = await child.communicate()
        except BaseException:
            child.kill()
            await child.wait()
            raise
    except OSError as cause:
        raise BinaryError(
            f"{path} cannot be run ({cause.strerror}); is it for this kind of machine? {WHERE}"
        ) from cause
    except TimeoutError as cause:
        raise BinaryError(f"{path} version did not answer within {_TIMEOUT_S:g} s") from cause
    found = _VERSION.search(output[:_MAX_OUTPUT].decode(errors="replace"))
    if child.returncode != 0 or found is None:
        raise BinaryError(f"{path} does not say its version; is it Fabric's {name}? {WHERE}")
    return found[1]
