"""Identities for a simulated world on a ledger that runs already, and for the backend that watches it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from wonderland_fabric_gateway.connection import FILE_NAME, Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.export import export_identities
from wonderland_simulator.scenario import DroneSpec, PadSite

OPERATORS: Final = ("admin", "inspector", "pad_operator", "fleet_operator")
"""Who registers pads and drones, and who approves what takes two people."""
MIRROR: Final = "mirror"
DAYS: Final = 365


async def enrol_on_fabric(directory: Path, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> Connection:
    """Enrol those that are missing with the CAs of a Fabric network. Raises `LedgerError`."""
    from wonderland_fabric_network import bringing_up, enrolment  # noqa: PLC0415 - an extra of its own
    from wonderland_fabric_network.layout import NetworkDirectory  # noqa: PLC0415

    places = NetworkDirectory(directory)
    with places.lock():
        network = bringing_up.open_network(places)
        there = Connection.load(places.connection_file).identities
        requests = [enrolment.Request(name, role, name) for name, role in _wanted(pads, drones) if name not in there]
        await enrolment.enrol(network, requests)
    return Connection.load(places.connection_file)


def enrol_on_embedded(directory: Path, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> Connection:
    """Enrol those that are missing with the embedded ledger's CAs. Raises `LedgerError`."""
    administration = DirectoryAdministration(LedgerDirectory(directory))
    there = Connection.load(directory / FILE_NAME).identities
    for name, role in _wanted(pads, drones):
        if name not in there:
            administration.enrol(name, role=role, pol_id=name, msp_id=None, days=DAYS)
    return Connection.load(directory / FILE_NAME)


def hand_out(connection: Connection, to: Path, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> None:
    """Write ``to/world`` for the world and ``to/backend`` for the backend, each with what it needs and no more.

    Who was handed out there before stays: a scenario that changed takes nobody's identity away.
    """
    world = to / "world"
    earlier = Connection.load(world / FILE_NAME).identities if (world / FILE_NAME).is_file() else {}
    names = [*OPERATORS, *(name for name, _ in _wanted(pads, drones)), *earlier]
    kept = dict.fromkeys(name for name in names if name in connection.identities or name not in earlier)
    export_identities(connection, kept, world, again=True)
    export_identities(connection, [MIRROR], to / "backend", again=True)


def _wanted(pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> list[tuple[str, str]]:
    return [*((pad.pad_id, "pad") for pad in pads), *((drone.uav_id, "uav") for drone in drones)]
