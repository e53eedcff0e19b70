"""What one machine needs of a ledger: some identities with their keys, and a connection.json of its own."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from wonderland_fabric_gateway.connection import FILE_NAME, ClientTls, Connection, IdentityFiles
from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


def export_identities(connection: Connection, names: Iterable[str], target: Path, *, again: bool = False) -> None:
    """Write these identities to a new or empty directory, private to its owner; `again`: also over an earlier export.

    Raises `ConnectionFileError` for a name that is not there, `FileWriteError`.
    """
    chosen = {name: connection.files(name) for name in names}
    try:
        target.mkdir(parents=True, exist_ok=True, mode=0o700)
        if not again and any(target.iterdir()):
            raise FileWriteError(f"{target} is not empty")
        root = target / "tls-ca.pem"
        write_atomic(root, connection.gateway.tls_ca.read_bytes(), PUBLIC)
        shown = connection.client_tls
        if shown is not None:
            copied = ClientTls(target / "client-tls.pem", target / "client-tls.key")
            write_atomic(copied.key, shown.key.read_bytes())
            write_atomic(copied.certificate, shown.certificate.read_bytes(), PUBLIC)
            shown = copied
        moved: dict[str, IdentityFiles] = {}
        for name, files in chosen.items():
            copy = IdentityFiles(files.msp_id, target / f"{name}.pem", target / f"{name}.key")
            write_atomic(copy.key, files.key.read_bytes())
            write_atomic(copy.certificate, files.certificate.read_bytes(), PUBLIC)
            moved[name] = copy
        authorities = {}
        for msp_id, authority in connection.authorities.items():
            authorities[msp_id] = replace(authority, tls_ca=target / f"ca-{msp_id}.pem")
            write_atomic(authorities[msp_id].tls_ca, authority.tls_ca.read_bytes(), PUBLIC)
    except OSError as cause:
        raise FileWriteError(f"{target}: {cause.strerror or cause}") from cause
    replace(
        connection,
        gateway=replace(connection.gateway, tls_ca=root),
        # Peers of one organisation have one TLS root.
        others=tuple(replace(each, tls_ca=root) for each in connection.others),
        client_tls=shown,
        identities=MappingProxyType(moved),
        authorities=MappingProxyType(authorities),
    ).save(target / FILE_NAME)
