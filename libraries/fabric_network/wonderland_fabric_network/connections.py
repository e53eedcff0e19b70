"""connection.json: one for each organisation with what is its own, and one with all, for trying things out."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.connection import (
    AuthorityAddress,
    ClientTls,
    Connection,
    GatewayAddress,
    IdentityFiles,
    LedgerKind,
)
from wonderland_fabric_gateway.embedded.organisations import ROLES
from wonderland_fabric_network.authorities import Certified
from wonderland_fabric_network.certificates import signing_identity
from wonderland_fabric_network.layout import CLIENT
from wonderland_fabric_network.settings import ca_name, tls_ca_name

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_network.network import Member, Network

KIND: Final = "fabric"
ROLES_OF_KIND: Final = {
    "authority": ("admin", "inspector", "mirror"),
    "pads": ("pad_operator", "pad"),
    "fleet": ("fleet_operator", "uav"),
}
"""The roles that an organisation's first start enrols; the same as the embedded ledger's."""


def first_identities(kind: str) -> tuple[Certified, ...]:
    """One identity per role, for the first start of an organisation of that kind."""
    return tuple(Certified.with_role(name, name, ROLES[name].pol_id) for name in ROLES_OF_KIND[kind])


def first_identity(network: Network) -> SigningIdentity:
    """Somebody of the first organisation here, to ask the contract as. Raises `LedgerError`."""
    home = network.organisations[0]
    name = first_identities(home.kind)[0].name
    return signing_identity(home.msp_id, network.directory.organisation(home.msp_id).identity(name))


def write_first(network: Network) -> None:
    """Write the files that are missing, and how the peers are reached now. Raises `LedgerError`."""
    for organisation in network.organisations:
        directory = network.directory.organisation(organisation.msp_id)
        _refresh(network, organisation.msp_id, directory.connection_file, (organisation.msp_id,))
        if not directory.connection_file.exists():
            found = {
                who.name: _files(network, organisation.msp_id, who.name)
                for who in first_identities(organisation.kind)
                if directory.identity(who.name).exist()
            }
            _connection(network, organisation.msp_id, found, (organisation.msp_id,)).save(directory.connection_file)
    if not network.organisations:  # who only orders has no clients
        return
    authority = network.organisations[0].msp_id
    _refresh(network, authority, network.directory.connection_file, _all(network))
    if not network.directory.connection_file.exists():
        everyone: dict[str, IdentityFiles] = {}
        for organisation in network.organisations:
            for name, files in Connection.load(
                network.directory.organisation(organisation.msp_id).connection_file
            ).identities.items():
                everyone[_combined_name(everyone, name, organisation.msp_id)] = files
        _connection(network, authority, everyone, _all(network)).save(network.directory.connection_file)


def add(network: Network, msp_id: str, name: str) -> None:
    """Put an enrolled identity into its organisation's file and into the combined one."""
    files = _files(network, msp_id, name)
    for path in (network.directory.organisation(msp_id).connection_file, network.directory.connection_file):
        connection = Connection.load(path)
        there = connection.identities
        combined = path == network.directory.connection_file
        key = _combined_name(there, name, msp_id) if combined else name
        if there.get(key) != files:
            connection.with_identity(key, files).save(path)


def add_all(network: Network, msp_id: str) -> None:
    """Put all that an organisation's own file has into the combined one."""
    for name in Connection.load(network.directory.organisation(msp_id).connection_file).identities:
        add(network, msp_id, name)


def remove(network: Network, msp_id: str, name: str) -> None:
    """Take an identity out of both."""
    for path in (network.directory.organisation(msp_id).connection_file, network.directory.connection_file):
        connection = Connection.load(path)
        for key in (name, f"{name}@{msp_id}"):
            files = connection.identities.get(key)
            if files is not None and files.msp_id == msp_id:
                connection = connection.without_identity(key)
        connection.save(path)


def _connection(
    network: Network, msp_id: str, identities: Mapping[str, IdentityFiles], authorities: tuple[str, ...]
) -> Connection:
    first, *others = [_gateway(network, member) for member in network.peers if member.msp_id == msp_id]
    shown = network.directory.organisation(msp_id).tls_identity(CLIENT)
    return Connection(
        channel=network.channel,
        chaincode=network.description.contract.name,
        gateway=first,
        identities=MappingProxyType(dict(identities)),
        ledger=LedgerKind(KIND, ""),
        others=tuple(others),
        client_tls=ClientTls(shown.certificate, shown.key),
        authorities=MappingProxyType({each: _authority(network, each) for each in authorities}),
    )


def _all(network: Network) -> tuple[str, ...]:
    return tuple(organisation.msp_id for organisation in network.organisations)


def _authority(network: Network, msp_id: str) -> AuthorityAddress:
    root = network.directory.organisation(msp_id).root
    return AuthorityAddress(network.authority(msp_id).address, ca_name(msp_id), root, tls_ca_name(msp_id))


def _gateway(network: Network, member: Member) -> GatewayAddress:
    host = network.hosts.of(member.msp_id, member.name)
    return GatewayAddress(
        network.address(member),
        network.directory.organisation(member.msp_id).tls_root,
        "localhost" if host in {"127.0.0.1", "::1"} else host,
    )


def _refresh(network: Network, msp_id: str, path: Path, authorities: tuple[str, ...]) -> None:
    """Bring an existing file up to date with the organisation's peers, its identities as they are."""
    if path.exists():
        there = Connection.load(path)
        wanted = _connection(network, msp_id, there.identities, authorities)
        if _reached(there) != _reached(wanted):
            wanted.save(path)


def _reached(connection: Connection) -> tuple[object, ...]:
    return connection.gateway, connection.others, connection.client_tls, dict(connection.authorities)


def _files(network: Network, msp_id: str, name: str) -> IdentityFiles:
    paths = network.directory.organisation(msp_id).identity(name)
    return IdentityFiles(msp_id, paths.certificate, paths.key)


def _combined_name(there: Mapping[str, IdentityFiles], name: str, msp_id: str) -> str:
    """A name that another organisation uses, too, is followed by its organisation."""
    taken = there.get(name)
    return name if taken is None or taken.msp_id == msp_id else f"{name}@{msp_id}"
