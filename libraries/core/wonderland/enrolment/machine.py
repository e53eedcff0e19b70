"""The machine's side: a request with keys that stay here, the admission taken, certificates renewed in time."""

from __future__ import annotations

import datetime as dt
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from wonderland.enrolment.records import MAX_BYTES, Admission, EnrolmentError, EnrolmentRequest
from wonderland_fabric_gateway.ca.certificates import new_private_key, private_key_pem
from wonderland_fabric_gateway.ca.requests import TLS_PROFILE, CertificateRequest
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.connection import (
    FILE_NAME,
    AuthorityAddress,
    ClientTls,
    Connection,
    GatewayAddress,
    IdentityFiles,
    LedgerKind,
)
from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_gateway.identity import Identity, SigningIdentity
from wonderland_fabric_gateway.signing import key_file_signer

if TYPE_CHECKING:
    from pathlib import Path

    from wonderland_fabric_gateway.ca.random import RandomBytes

_TLS: Final = "client-tls"


class Place:
    """The directory of one machine's identity: keys, certificates, connection.json, private to its user."""

    def __init__(self, path: Path) -> None:
        self.path: Final = path

    @property
    def connection(self) -> Path:
        """connection.json, once it was admitted."""
        return self.path / FILE_NAME

    def request(self, name: str) -> Path:
        """The request that waits for its admission."""
        return self.path / f"{name}.request"

    def key(self, name: str) -> Path:
        """The identity's key, or where it is in a hardware module."""
        return self.path / f"{name}.key"

    @property
    def tls_key(self) -> Path:
        """What TLS connections are made with; a file, whatever the identity's key is."""
        return self.path / f"{_TLS}.key"

    def make(self) -> None:
        """Private to its owner. Raises `EnrolmentError`."""
        try:
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as cause:
            raise EnrolmentError(f"{self.path}: cannot be made ({cause.strerror})") from cause


def make_request(
    place: Place, name: str, role: str, pol_id: str, *, key: Path | None, now: dt.datetime, random_bytes: RandomBytes
) -> EnrolmentRequest:
    """A request by keys that are made here, or by a key that is here already. The same again where one waits.

    ``key``: a file with the key, or with the PKCS#11 URI of one in a hardware module. Raises `LedgerError`,
    `ProofError`.
    """
    place.make()
    waiting = place.request(name)
    if waiting.exists():
        there = read_request(waiting)
        if (there.role, there.pol_id) != (role, pol_id):
            raise EnrolmentError(f"{waiting} asks for {there.role} {there.pol_id}. Next: admit that, or remove it")
        return there
    if key is not None and key.resolve() != place.key(name).resolve():
        if place.key(name).exists():
            raise EnrolmentError(f"{place.key(name)} is there already. Next: leave --key away, or remove it")
        write_atomic(place.key(name), read_bounded(key, EnrolmentError, "key"))
    for path in (place.key(name), place.tls_key):
        if not path.exists():
            write_atomic(path, private_key_pem(new_private_key(random_bytes)))
    made = EnrolmentRequest.parse(
        EnrolmentRequest(
            name=name,
            role=role,
            pol_id=pol_id,
            request=CertificateRequest.of_key_file(name, place.key(name)).pem,
            tls_request=CertificateRequest.of_key_file(name, place.tls_key).pem,
            t_s=int(now.timestamp()),
        ).to_json()
    )
    write_atomic(waiting, made.encode() + b"\n", PUBLIC)
    return made


def read_request(path: Path) -> EnrolmentRequest:
    """A request of a file. Raises `EnrolmentError`."""
    return EnrolmentRequest.read(read_bounded(path, EnrolmentError, "request", MAX_BYTES), str(path))


def read_admission(path: Path) -> Admission:
    """An admission of a file. Raises `EnrolmentError`."""
    return Admission.read(read_bounded(path, EnrolmentError, "admission", MAX_BYTES), str(path))


def accept(place: Place, admission: Admission) -> str:
    """Take an admission: certificates, connection.json; the identity's name. Raises `EnrolmentError`, `LedgerError`."""
    waiting = [read_request(path) for path in sorted(place.path.glob("*.request"))]
    if not waiting:
        raise EnrolmentError(f"{place.path}: no request waits here. Next: `wonderland enrol request`")
    request = next((each for each in waiting if each.sha256 == admission.request_sha256), waiting[0])
    admission.require_answers(request)
    name = request.name
    if place.connection.exists() and (taken := set(Connection.load(place.connection).identities) - {name}):
        raise EnrolmentError(
            f"{place.connection} is that of {', '.join(sorted(taken))} already. Next: use another --dir for {name}"
        )
    files = {
        place.path / f"{name}.pem": admission.certificate,
        place.path / "tls-ca.pem": admission.tls_root,
    }
    tls = None
    if admission.tls_certificate is not None:
        tls = ClientTls(place.path / f"{_TLS}.pem", place.tls_key)
        files[tls.certificate] = admission.tls_certificate
    authorities = {}
    if admission.authority is not None:
        its = admission.authority
        root = place.path / f"ca-{admission.msp_id}.pem"
        files[root] = its.root
        authorities[admission.msp_id] = AuthorityAddress(its.address, its.ca_name, root, its.tls_ca_name)
    for path, text in files.items():
        write_atomic(path, text.encode(), PUBLIC)
    first, *others = [
        GatewayAddress(each.address, place.path / "tls-ca.pem", each.server_name) for each in admission.gateways
    ]
    Connection(
        channel=admission.channel,
        chaincode=admission.chaincode,
        gateway=first,
        others=tuple(others),
        identities=MappingProxyType(
            {name: IdentityFiles(admission.msp_id, place.path / f"{name}.pem", place.key(name))}
        ),
        client_tls=tls,
        authorities=MappingProxyType(authorities),
        ledger=LedgerKind(admission.ledger_kind, admission.notice),
    ).save(place.connection)
    place.request(name).unlink()
    return name


async def renew(connection: Connection, name: str, *, within: dt.timedelta, now: dt.datetime) -> list[str]:
    """New certificates for the keys that are here, from the organisation's CA, of those that end within that time.

    What was renewed; the files are replaced whole, so that whoever opens them has the old one or the new one. Raises
    `EnrolmentError`, `LedgerError`.
    """
    files = connection.files(name)
    due = [("identity", files.certificate, files.key)] if _ends(files.certificate) - now <= within else []
    tls = connection.client_tls
    if tls is not None and _ends(tls.certificate) - now <= within:
        due.append(("TLS", tls.certificate, tls.key))
    if not due:
        return []
    authority = connection.authorities.get(files.msp_id)
    if authority is None or not authority.tls_ca_name:
        raise EnrolmentError(
            f"connection.json names no CA of {files.msp_id} to renew with. Next: `wonderland enrol request` anew, and "
            "have it admitted"
        )
    from wonderland_fabric_gateway.ca.client import FabricCaClient  # noqa: PLC0415 - needs the extra client

    root = read_bounded(authority.tls_ca, EnrolmentError, "root of the CA")
    done = []
    for what, certificate, key in due:
        is_tls = what == "TLS"
        current = SigningIdentity(Identity.from_file(files.msp_id, certificate), key_file_signer(key))
        request = CertificateRequest.of_key_file(current.identity.common_name, key)
        ca_name = authority.tls_ca_name if is_tls else authority.ca_name
        async with FabricCaClient(authority.address, ca_name, root) as ca:
            pem = await ca.reenrol(current, request, profile=TLS_PROFILE if is_tls else "")
        write_atomic(certificate, pem, PUBLIC)
        done.append(f"{what} certificate of {name}, valid until {_ends(certificate):%Y-%m-%d}")
    return done


def _ends(path: Path) -> dt.datetime:
    try:
        return certificate_of(read_bounded(path, EnrolmentError, "certificate")).not_valid_after_utc
    except ValueError as cause:
        raise EnrolmentError(f"{path}: no PEM certificate ({cause})") from cause
