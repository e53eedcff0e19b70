"""The demo's registrar: it invites whoever asks. Never part of a server that is no demo (`serve` refuses)."""

from __future__ import annotations

import asyncio
from pathlib import Path

from wonderland_backend.transactions.enrolment import Registrar
from wonderland_fabric_gateway.ca.invitations import Invited
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory


def registrar_of(directory: Path, *, embedded: bool) -> Registrar:
    """The registrar with the certificate authorities in a ledger's, or a Fabric network's, directory."""
    return _of_embedded(directory) if embedded else _of_network(directory)


def _of_embedded(directory: Path) -> Registrar:
    administration = DirectoryAdministration(LedgerDirectory(directory))

    async def invite(name: str, role: str) -> Invited:
        return await asyncio.to_thread(administration.invite, name, role=role, pol_id=name)

    return invite


def _of_network(directory: Path) -> Registrar:
    async def invite(name: str, role: str) -> Invited:
        from wonderland_fabric_network import bringing_up, enrolment  # noqa: PLC0415 - an extra of its own
        from wonderland_fabric_network.layout import NetworkDirectory  # noqa: PLC0415

        network = await asyncio.to_thread(bringing_up.open_network, NetworkDirectory(directory))
        return await enrolment.invite(network, enrolment.Request(name, role, name))

    return invite
