"""Managing a ledger's directory from outside its process: enrolling, renewing, revoking, asking how it does.

The CAs are files that several processes may use at once. What must reach a running ledger goes through its own Gateway
API: an organisation's administrator evaluates ``_ledger RefreshRevocations`` and the ledger reads its CAs' revocation
lists. A ledger that does not run reads them when it starts.
"""

from __future__ import annotations

import datetime as dt
import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.attributes import ID, ROLE
from wonderland_fabric_gateway.ca import (
    AlreadyEnrolledError,
    CaNotFoundError,
    CaRequestError,
    IssuedCertificate,
    Kind,
    UnknownCertificateError,
)
from wonderland_fabric_gateway.ca.invitations import Invited
from wonderland_fabric_gateway.connection import FILE_NAME, Connection, IdentityFiles
from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.directory import NODE_NAMES, LedgerDirectory
from wonderland_fabric_gateway.embedded.errors import DirectoryError
from wonderland_fabric_gateway.embedded.state import StateReader
from wonderland_fabric_gateway.embedded.system import KIND, LEDGER
from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_fabric_gateway.files import PUBLIC, write_atomic
from wonderland_fabric_gateway.gateway import Gateway

if TYPE_CHECKING:
    from pathlib import Path

    from wonderland_fabric_gateway.ca import CertificateRequest, Enrolment

_STATUS_DEADLINE_S: Final = 10.0
INVITATION_HOURS: Final = 72


@dataclass(frozen=True)
class Issued:
    """A certificate that was just issued, and where it is."""

    name: str
    msp_id: str
    serial: str
    valid_until: str
    certificate: Path
    key: Path

    def as_json(self) -> dict[str, str]:
        """All of it as JSON values."""
        return {
            "name": self.name,
            "msp_id": self.msp_id,
            "serial": self.serial,
            "valid_until": self.valid_until,
            "certificate": str(self.certificate),
            "key": str(self.key),
        }


class DirectoryAdministration:
    """The operations. Each raises `LedgerError` with what was wrong."""

    def __init__(self, directory: LedgerDirectory) -> None:
        self._directory = directory

    def enrol(self, name: str, *, role: str, pol_id: str, msp_id: str | None = None, days: int = 365) -> Issued:
        """Enrol a name with a role; the organisation is the role's, or another operator of pads that is named."""
        home = self.home_of(name, role, msp_id)
        current = self._connection().identities.get(name)
        if current is not None and current.msp_id != home:
            raise CaRequestError(f"{name} is an identity of {current.msp_id} already; choose another name")
        enrolment = self._directory.ca(home).enrol(
            name, attributes={ROLE: role, ID: pol_id}, validity=dt.timedelta(days=days)
        )
        return self._store(enrolment)

    def invite(
        self,
        name: str,
        *,
        role: str,
        pol_id: str,
        msp_id: str | None = None,
        days: int = 365,
        hours: int = INVITATION_HOURS,
    ) -> Invited:
        """Let a name enrol by itself, once, with a key that it makes: the one-time secret is in what is returned."""
        home = self.home_of(name, role, msp_id)
        secret = self._directory.invitations(home).invite(
            name, {ROLE: role, ID: pol_id}, validity=dt.timedelta(days=days), good_for=dt.timedelta(hours=hours)
        )
        return Invited(name, home, role, secret)

    def admit(self, request: CertificateRequest, *, role: str, pol_id: str, msp_id: str, days: int = 365) -> bytes:
        """A certificate (PEM) for a key that was made elsewhere; also a newer one for a name that has that role."""
        ca = self._directory.ca(self.home_of(request.name, role, msp_id))
        wanted, validity = {ROLE: role, ID: pol_id}, dt.timedelta(days=days)
        known = ca.certificates(request.name, Kind.IDENTITY)
        if known and known[-1].revoked_ms is None:
            if known[-1].attributes != wanted:
                raise AlreadyEnrolledError(
                    f"{request.name} has a certificate for another role or id; choose another name"
                )
            return ca.renew(request.name, validity=validity, public_key=request.public_key).certificate_pem
        return ca.enrol(
            request.name, attributes=wanted, validity=validity, public_key=request.public_key
        ).certificate_pem

    async def renew(self, name: str, *, msp_id: str | None = None, days: int = 365, revoke_old: bool = False) -> Issued:
        """A new key and certificate for a name, in place of those in the directory."""
        home = self._home(name, msp_id)
        enrolment = self._directory.ca(home).renew(name, validity=dt.timedelta(days=days), revoke_old=revoke_old)
        issued = self._store(enrolment)
        if revoke_old:
            await self._reach(home)
        return issued

    async def revoke(
        self, name: str | None, *, serial: str | None = None, msp_id: str | None = None, reason: str = "unspecified"
    ) -> tuple[tuple[IssuedCertificate, ...], dict[str, Any]]:
        """Revoke, and have a running ledger know it; what was revoked, and ``{"running", "block"}``."""
        if name in NODE_NAMES:
            raise CaRequestError(f"{name!r} is the ledger's own; a ledger does not revoke itself")
        if (name is None) == (serial is None):
            raise CaRequestError("say either the name or the serial number of what is to be revoked")
        home = self._home(name, msp_id) if name is not None else self._home_of_serial(serial or "", msp_id)
        revoked = self._directory.ca(home).revoke(name=name, serial=serial, reason=reason)
        return revoked, await self._reach(home)

    def certificates(self, msp_id: str | None = None) -> list[dict[str, Any]]:
        """Every identity certificate issued, oldest first, as JSON values."""
        now_ms = int(dt.datetime.now(dt.UTC).timestamp() * 1000)
        return [
            {
                "msp_id": each,
                "name": issued.name,
                "serial": issued.serial,
                "node_ou": issued.node_ou,
                "role": issued.attributes.get(ROLE, ""),
                "id": issued.attributes.get(ID, ""),
                "valid_until": _day(issued.not_after_ms),
                "state": "revoked" if issued.revoked_ms else "valid" if issued.is_active(now_ms) else "expired",
            }
            for each in ([self._known(msp_id)] if msp_id else self._directory.organisations)
            for issued in self._directory.ca(each).certificates(kind=Kind.IDENTITY)
        ]

    async def status(self) -> dict[str, Any]:
        """How the ledger does, as JSON values; read from its files when it does not run."""
        running = self._directory.running_pid() is not None
        if running:
            answer: dict[str, Any] = await self._ask("Describe", orgs.AUTHORITY)
            return {"running": True, "address": self._connection().gateway.address, **answer}
        if not self._directory.database.exists():
            raise DirectoryError(f"there is no ledger in {self._directory.path}; `wonderland ledger start` makes one")
        reader = StateReader(self._directory.database)
        try:
            tip = reader.tip()
        finally:
            reader.close()
        return {
            "running": False,
            "kind": KIND,
            "notice": NOTICE,
            "channel": self._connection().channel,
            "height": tip.number + 1,
            "tip_hash": tip.header_hash.hex(),
        }

    def export(self, name: str, target: Path) -> None:
        """A directory with one identity and its own connection.json, for another machine."""
        connection = self._connection()
        if name not in connection.identities:
            raise CaRequestError(f"{name} is not in {self._directory.connection_file}; enrol it first")
        files = connection.identities[name]
        try:
            target.mkdir(parents=True, exist_ok=True, mode=0o700)
            if any(target.iterdir()):
                raise FileWriteError(f"{target} is not empty")
            certificate, key = target / f"{name}.pem", target / f"{name}.key"
            write_atomic(key, files.key.read_bytes())
            write_atomic(certificate, files.certificate.read_bytes(), PUBLIC)
            root = target / "tls-ca.pem"
            write_atomic(root, connection.gateway.tls_ca.read_bytes(), PUBLIC)
        except OSError as cause:
            raise FileWriteError(f"{target}: {cause.strerror or cause}") from cause
        replace(
            connection,
            gateway=replace(connection.gateway, tls_ca=root),
            identities={name: IdentityFiles(files.msp_id, certificate, key)},
        ).save(target / FILE_NAME)

    def _store(self, enrolment: Enrolment) -> Issued:
        """Write the files and connection.json."""
        certificate = enrolment.certificate
        files = self._directory.identity_files(certificate.name)
        enrolment.write(files[0].parent, certificate.name)

        def change(current: Connection | None) -> Connection:
            if current is None:
                raise DirectoryError(f"{self._directory.connection_file} is missing; start the ledger once")
            return current.with_identity(certificate.name, IdentityFiles(enrolment.msp_id, *files))

        self._directory.update_connection(change)
        return Issued(
            certificate.name, enrolment.msp_id, certificate.serial, _day(certificate.not_after_ms), files[0], files[1]
        )

    async def _reach(self, msp_id: str) -> dict[str, Any]:
        """Have a running ledger read its revocation lists."""
        if self._directory.running_pid() is None:
            return {"running": False, "block": None}
        answer = await self._ask("RefreshRevocations", msp_id)
        return {"running": True, "block": answer.get("block")}

    async def _ask(self, function: str, msp_id: str) -> dict[str, Any]:
        """Evaluate a query of the ledger itself as an organisation's administrator."""
        connection = self._connection()
        administrator = self._directory.administrator(msp_id)
        async with connection.open_channel() as channel:
            gateway = Gateway(channel, administrator.identity, administrator.sign)
            contract = gateway.network(connection.channel).contract(LEDGER)
            answer: dict[str, Any] = json.loads(await contract.evaluate(function))
        return answer

    def _connection(self) -> Connection:
        if not self._directory.connection_file.exists():
            raise DirectoryError(f"there is no ledger in {self._directory.path}; `wonderland ledger start` makes one")
        return Connection.load(self._directory.connection_file)

    def home_of(self, name: str, role: str, msp_id: str | None = None) -> str:
        """The organisation that gives a name a role. Raises `CaRequestError`."""
        if name in NODE_NAMES:
            raise CaRequestError(f"the name {name!r} belongs to the ledger itself")
        home = orgs.ROLES[role].msp_id
        homes = (home, *(self._directory.pad_operators if role in orgs.PAD_ROLES else ()))
        if msp_id is not None and msp_id not in homes:
            raise CaRequestError(f"the role {role} belongs to {' or '.join(homes)}, not to {msp_id}")
        return msp_id or home

    def _home(self, name: str, msp_id: str | None) -> str:
        """The organisation that a name belongs to. Raises `UnknownCertificateError` or `CaRequestError`."""
        if msp_id is not None:
            return self._known(msp_id)
        homes = [each for each in self._directory.organisations if self._has(each, name)]
        if not homes:
            raise UnknownCertificateError(f"no organisation's CA ever enrolled {name!r}")
        if len(homes) > 1:
            raise CaRequestError(f"{name} was enrolled by {' and '.join(homes)}; say which with --org")
        return homes[0]

    def _home_of_serial(self, serial: str, msp_id: str | None) -> str:
        if msp_id is not None:
            return self._known(msp_id)
        plain = serial.lower().replace(":", "").removeprefix("0x").lstrip("0")
        for each in self._directory.organisations:
            if any(issued.serial == plain for issued in self._directory.ca(each).certificates()):
                return each
        raise UnknownCertificateError(f"no organisation's CA issued the serial number {serial}")

    def _known(self, msp_id: str) -> str:
        if msp_id not in self._directory.organisations:
            raise CaRequestError(
                f"{msp_id[:80]} is no organisation of this ledger; there are {', '.join(self._directory.organisations)}"
            )
        return msp_id

    def _has(self, msp_id: str, name: str) -> bool:
        try:
            return bool(self._directory.ca(msp_id).certificates(name, Kind.IDENTITY))
        except CaNotFoundError as cause:
            raise DirectoryError(
                f"there is no ledger in {self._directory.path}; `wonderland ledger start` makes one"
            ) from cause


def _day(t_ms: int) -> str:
    return dt.datetime.fromtimestamp(t_ms / 1000, dt.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
