"""Which package somebody has to install, where a command or a module is not here."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import metadata
from typing import Final

COMMANDS: Final = {
    "attack": "wonderland-research",
    "backend": "wonderland-backend",
    "backup": "wonderland-backend",
    "bus": "wonderland-backend",
    "chaincode": "wonderland-chaincode",
    "demo": "wonderland-simulator",
    "doctor": "wonderland-core",
    "enrol": "wonderland-core",
    "evaluate": "wonderland-research",
    "evidence": "wonderland-evidence",
    "ledger": "wonderland-fabric-gateway",
    "network": "wonderland-fabric-network",
    "pad": "wonderland-edge-agent",
    "protocol": "wonderland-research",
    "registry": "wonderland-core",
    "remote-id": "wonderland-remote-id",
    "reproduce": "wonderland-research",
    "restore": "wonderland-backend",
    "ros1": "wonderland-ros-bridge",
    "ros2": "wonderland-ros-bridge",
    "simulate": "wonderland-simulator",
    "uav": "wonderland-uav-agent",
    "uwb": "wonderland-core",
    "world": "wonderland-simulator",
}
"""Distribution by command; those that are installed say it themselves, these are for those that are not."""

DEBIAN: Final = {
    "wonderland-backend": "wonderland-backend",
    "wonderland-edge-agent": "wonderland-pad",
    "wonderland-uav-agent": "wonderland-uav",
}
"""Debian package by distribution. The package `wonderland` has what else is packaged."""

_PROJECT: Final = "wonderland"
_DISTRIBUTION_OF: Final = {"crypto": "pycryptodome", "pkcs11": "python-pkcs11"}
"""Where a module is not called as its distribution is."""
_NAME: Final = re.compile(r"[A-Za-z0-9][\w.-]*")
_REQUIRED_BY_EXTRA: Final = re.compile(r"^([A-Za-z0-9][\w.-]*).*\bextra\s*==\s*['\"]([\w.-]+)['\"]")


def of_command(name: str) -> str | None:
    """What to say of a command that no installed package has; None where there is no such command."""
    distribution = COMMANDS.get(name)
    if distribution is None:
        return None
    there = f"`wonderland {name}` is in {distribution}, which is not installed here: pip install {distribution}"
    package = DEBIAN.get(distribution)
    return there if package is None else f"{there} (Debian: apt install ./{package}_….deb)"


def of_module(module: str, first: str | None = None) -> str:
    """What to say of a module that is missing; `first`: the distribution whose extras are looked at first."""
    top = module.partition(".")[0]
    wanted = _normal(_DISTRIBUTION_OF.get(top.lower(), top))
    if wanted.startswith(_PROJECT):
        return f"this needs {wanted}, which is not installed here: pip install {wanted}"
    near = _required_by(first)
    found = sorted(
        {each for each in _extras() if each[0] == wanted},
        key=lambda each: (each[1] not in near[:1], each[1] not in near, each),
    )
    if wanted in near or not found:
        return f"the module {module} is missing: this installation is not whole; install {first or _PROJECT} anew"
    _, distribution, extra = found[0]
    return f"this needs {wanted}, which the extra {extra} brings: pip install '{distribution}[{extra}]'"


def _required_by(distribution: str | None) -> list[str]:
    """The distribution itself, then what it requires in any case."""
    try:
        lines = metadata.requires(distribution) if distribution else None
    except metadata.PackageNotFoundError:
        lines = None
    names = (_NAME.match(line) for line in lines or () if "extra ==" not in line)
    return [_normal(each) for each in (distribution or "", *(match[0] for match in names if match))]


def _extras() -> Iterator[tuple[str, str, str]]:
    """(what is required, by which of our distributions, for which extra)."""
    for each in metadata.distributions():
        name = _normal(each.metadata["Name"] or "")
        if name.startswith(_PROJECT):
            for line in each.requires or ():
                if match := _REQUIRED_BY_EXTRA.match(line):
                    yield _normal(match[1]), name, match[2]


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
