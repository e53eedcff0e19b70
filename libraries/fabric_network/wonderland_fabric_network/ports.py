"""Who listens where: ports chosen once for a network and kept, since the channel's configuration names some of them."""

from __future__ import annotations

import errno
import json
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_network.description import EACH
from wonderland_fabric_network.errors import DirectoryStateError, PortInUseError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping
    from pathlib import Path

    from wonderland_fabric_network.description import NetworkDescription
    from wonderland_fabric_network.membership import Membership

FREE_RANGE: Final = (15_000, 32_000)
"""Below the range from which systems take the ports of outgoing connections: those could be taken while we are down."""
_ATTEMPTS: Final = 2_000
USUAL: Final = {
    "ca": {"listen": 7054, "operations": 9443},
    "orderer": {"listen": 7050, "admin": 7053, "operations": 9443},
    "peer": {"listen": 7051, "chaincode": 7052, "operations": 9443},
    "contract": {"a": 9999, "b": 9999, "metrics-a": 9443, "metrics-b": 9443},
}
"""Where each kind listens when it has a host of its own: Fabric's usual ports, and one for all that is watched."""


@dataclass(frozen=True)
class Ports:
    """Port by what listens on it, for example ``PadMSP/peer0/listen``."""

    by_name: Mapping[str, int]

    def __getitem__(self, name: str) -> int:
        return self.by_name[name]

    def of(self, component: str) -> tuple[int, ...]:
        """The ports of one component."""
        return tuple(port for name, port in self.by_name.items() if name.startswith(f"{component}/"))


def needed(description: NetworkDescription, mine: Collection[str] | None = None) -> tuple[str, ...]:
    """The names of all ports that a network needs; those of some organisations of it."""
    names: list[str] = []
    for ordering in description.ordering.organisations:
        names += _of(ordering.msp_id, "ca", "listen", "operations")
        for index in range(ordering.orderers):
            names += _of(ordering.msp_id, f"orderer{index}", "listen", "admin", "operations")
    for organisation in description.organisations:
        names += _of(organisation.msp_id, "ca", "listen", "operations")
        names += _of(organisation.msp_id, "contract", "a", "b", "metrics-a", "metrics-b")
        for index in range(organisation.peers):
            names += _of(organisation.msp_id, f"peer{index}", "listen", "chaincode", "operations")
    return tuple(name for name in names if mine is None or name.partition("/")[0] in mine)


def allot(
    path: Path,
    description: NetworkDescription,
    random_bytes: Callable[[int], bytes],
    membership: Membership | None = None,
) -> Ports:
    """The ports of ports.json, with new ones for what has none yet; written before they are used.

    `membership`: only some organisations are here, and the others' ports are on their cards. Components with hosts of
    their own have the usual ports, and no file. Raises `PortInUseError`, `DirectoryStateError`.
    """
    if description.hosts == EACH:
        return Ports({name: _usual(name) for name in needed(description)})
    known = _load(path) if path.exists() else {}
    names = needed(description, None if membership is None else membership.mine)
    missing = [name for name in names if name not in known]
    if missing:
        chosen = (
            _counted(description, set(known.values()), missing)
            if description.first_port
            else _free(description.host, set(known.values()), missing, random_bytes)
        )
        known.update(chosen)
        write_atomic(path, json.dumps(known, indent=1).encode() + b"\n", PUBLIC)
    return Ports({name: known[name] for name in names} | ({} if membership is None else membership.ports))


def require_free(host: str, ports: Iterable[int], component: str) -> None:
    """Raise `PortInUseError` when somebody listens on one of these ports."""
    for port in ports:
        if not is_free(host, port):
            raise PortInUseError(
                f"{component}: port {port} of {host} is in use by another program. Next: stop that program (`ss -ltnp "
                f"'sport = :{port}'` names it), or change ports.json before the first `up`"
            )


def is_free(host: str, port: int) -> bool:
    """Whether one could listen there now."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as cause:
            if cause.errno in {errno.EADDRINUSE, errno.EACCES}:
                return False
            raise PortInUseError(
                f"{host}: cannot be listened on ({cause.strerror}); set host to an own address"
            ) from cause
    return True


def _usual(name: str) -> int:
    _, component, port = name.split("/")
    return USUAL[component.rstrip("0123456789")][port]


def _of(msp_id: str, component: str, *names: str) -> list[str]:
    return [f"{msp_id}/{component}/{name}" for name in names]


def _load(path: Path) -> dict[str, int]:
    try:
        document = json.loads(read_bounded(path, DirectoryStateError, "ports"))
    except ValueError as cause:
        raise DirectoryStateError(f"{path}: no JSON ({cause})") from cause
    if not isinstance(document, dict) or not all(
        isinstance(port, int) and 0 < port < 65_536 for port in document.values()
    ):
        raise DirectoryStateError(f"{path}: should map names to port numbers")
    if len(set(document.values())) != len(document):
        raise DirectoryStateError(f"{path}: a port stands twice")
    return document


def _counted(description: NetworkDescription, taken: set[int], names: list[str]) -> dict[str, int]:
    chosen: dict[str, int] = {}
    port = description.first_port
    for name in names:
        while port in taken:
            port += 1
        require_free(description.host, [port], name)
        chosen[name] = port
        port += 1
    return chosen


def _free(host: str, taken: set[int], names: list[str], random_bytes: Callable[[int], bytes]) -> dict[str, int]:
    chosen: dict[str, int] = {}
    first, end = FREE_RANGE
    for _ in range(_ATTEMPTS):
        if len(chosen) == len(names):
            return chosen
        port = first + int.from_bytes(random_bytes(4), "big") % (end - first)
        if port not in taken and is_free(host, port):
            taken.add(port)
            chosen[names[len(chosen)]] = port
    raise PortInUseError(f"{host}: no {len(names)} free ports between {first} and {end}")
