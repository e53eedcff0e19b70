"""The peer's external builder for contracts that run as services; the peer runs it, standard library only.

    python builder.py detect SOURCE METADATA
    python builder.py build SOURCE METADATA OUTPUT
    python builder.py release OUTPUT RELEASE

It does what the builder in Fabric's official images does: ``{{.name}}`` in a package's connection.json is replaced by
what CHAINCODE_AS_A_SERVICE_BUILDER_CONFIG says (a JSON object), and the result goes to the peer. Source: Fabric
"External Builders and Launchers", ``ccaas_builder``.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

VARIABLE = "CHAINCODE_AS_A_SERVICE_BUILDER_CONFIG"
TEMPLATES = ("address", "dial_timeout", "root_cert", "client_key", "client_cert")
_MARK = re.compile(r"\{\{\s*\.(\w+)\s*\}\}")


class BuilderError(Exception):
    """What the peer's log shows."""


def detect(_source: Path, metadata: Path) -> bool:
    """Whether a package is for us."""
    return _read(metadata / "metadata.json").get("type") == "ccaas"


def build(source: Path, _metadata: Path, output: Path) -> None:
    """Fill the connection's templates in."""
    values = json.loads(os.environ.get(VARIABLE) or "{}")
    connection = _read(source / "connection.json")
    for name in TEMPLATES:
        if isinstance(connection.get(name), str):
            connection[name] = _fill(connection[name], values)
    target = output / "connection.json"
    target.touch(mode=0o600)
    target.write_text(json.dumps(connection))
    if (source / "META-INF").is_dir():
        shutil.copytree(source / "META-INF", output / "META-INF")


def release(output: Path, target: Path) -> None:
    """Give the peer what it connects by."""
    server = target / "chaincode" / "server"
    server.mkdir(parents=True, exist_ok=True, mode=0o700)
    shutil.copyfile(output / "connection.json", server / "connection.json")
    (server / "connection.json").chmod(0o600)
    if (output / "META-INF" / "statedb").is_dir():
        shutil.copytree(output / "META-INF" / "statedb", target / "statedb")


def main(arguments: list[str]) -> int:
    """Exit code 0 when done (for detect: when it is for us), 1 otherwise."""
    try:
        command, *places = arguments
        return 0 if _run(command, [Path(place) for place in places]) else 1
    except (BuilderError, OSError, ValueError, KeyError, TypeError) as error:
        print(f"contract builder: {error}", file=sys.stderr)  # noqa: T201 - the peer logs it
        return 1


def _run(command: str, places: list[Path]) -> bool:
    if command == "detect":
        return detect(*places)
    if command == "build":
        build(*places)
    elif command == "release":
        release(*places)
    else:
        raise BuilderError(f"{command!r} is none of detect, build, release")
    return True


def _fill(text: str, values: dict[str, Any]) -> str:
    def value(found: re.Match[str]) -> str:
        if found[1] not in values:
            raise BuilderError(f"{VARIABLE} has no {found[1]!r}")
        return str(values[found[1]])

    return _MARK.sub(value, text)


def _read(path: Path) -> dict[str, Any]:
    document = json.loads(path.read_text())
    if not isinstance(document, dict):
        raise BuilderError(f"{path.name} is no JSON object")
    return document


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
