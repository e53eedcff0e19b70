"""An organisation's certificate authority in a directory: for the embedded ledger, development and single sites.

It does what a Fabric CA does for enrolment (names, node OUs, attributes, renewal, revocation) without a server.
Whoever can read the directory can enrol anybody: keep it where only the organisation's administrator can.

    ca.pem, ca.key           root of the identities
    tls-ca.pem, tls-ca.key   root of the TLS certificates
    ca.json                  the organisation's MSP id
    register.db              every certificate issued and revoked, and the current revocation lists
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key

from wonderland_fabric_gateway.ca import certificates as build
from wonderland_fabric_gateway.ca.application import VALIDITY, Application, Kind
from wonderland_fabric_gateway.ca.errors import (
    AlreadyEnrolledError,
    CaCorruptError,
    CaExistsError,
    CaNotFoundError,
    CaRequestError,
    CaStorageError,
    UnknownCertificateError,
)
from wonderland_fabric_gateway.ca.register import (
    IssuedCertificate,
    Register,
    RevocationList,
    create_register,
    milliseconds,
    moment,
    open_register,
)
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.errors import FileWriteError, SignatureError
from wonderland_fabric_gateway.files import PRIVATE, PUBLIC, read_bounded, sync_directory, write_atomic
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import require_p256

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from contextlib import AbstractContextManager

    from wonderland_fabric_gateway.ca.random import RandomBytes

ROOT_VALIDITY: Final = timedelta(days=15 * 365)
REVOCATION_LIST_VALIDITY: Final = timedelta(days=30)
BACKDATE: Final = timedelta(minutes=5)
"""Certificates begin this much in the past, so that a machine whose clock is a little behind accepts them."""

_MSP_ID: Final = re.compile(r"[A-Za-z][A-Za-z0-9.-]{0,63}")
_SERIAL: Final = re.compile(r"[0-9a-f]{1,40}")
_FILES: Final = {Kind.IDENTITY: "ca", Kind.TLS: "tls-ca"}


@dataclass(frozen=True, slots=True)
class Enrolment:
    """What an enrolment gives. `private_key_pem` is None when the applicant brought the public key."""

    msp_id: str
    certificate: IssuedCertificate
    private_key_pem: bytes | None

    @property
    def certificate_pem(self) -> bytes:
        """The certificate that was issued, in PEM."""
        return self.certificate.pem

    @property
    def identity(self) -> Identity:
        """Organisation and certificate, as transactions name their creator."""
        return Identity(self.msp_id, self.certificate.pem)

    def write(self, directory: Path, stem: str | None = None) -> tuple[Path, Path]:
        """Write ``<stem>.pem`` and ``<stem>.key`` (mode 0600), `stem` being the name; returns both paths.

        Raises `CaRequestError` without a private key to write, `FileWriteError`.
        """
        if self.private_key_pem is None:
            raise CaRequestError(f"{self.certificate.name}: its private key was made elsewhere and stays there")
        _make_private_directory(directory)
        stem = stem or self.certificate.name
        certificate, key = directory / f"{stem}.pem", directory / f"{stem}.key"
        write_atomic(key, self.private_key_pem, PRIVATE)
        write_atomic(certificate, self.certificate.pem, PUBLIC)
        return certificate, key


class LocalCa:
    """The CA of one organisation. Several processes may use the same directory; operations exclude each other."""

    def __init__(
        self,
        directory: Path,
        msp_id: str,
        authorities: Mapping[Kind, build.Authority],
        *,
        now: Callable[[], datetime],
        random_bytes: RandomBytes,
    ) -> None:
        self.directory: Final = directory
        self.msp_id: Final = msp_id
        self._authorities = authorities
        self._now = now
        self._random_bytes = random_bytes

    @classmethod
    def create(
        cls,
        directory: Path,
        msp_id: str,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        random_bytes: RandomBytes = os.urandom,
    ) -> LocalCa:
        """Make a new CA with fresh keys; `directory` must not exist, or be empty.

        It appears whole or not at all. Raises `CaExistsError`, `CaRequestError`, `CaStorageError`.
        """
        if not _MSP_ID.fullmatch(msp_id):
            raise CaRequestError(f"MSP id {msp_id!r}: a letter, then up to 63 letters, digits, dots and hyphens")
        begin = now().replace(microsecond=0) - BACKDATE
        try:
            directory.parent.mkdir(parents=True, exist_ok=True)
            building = Path(tempfile.mkdtemp(prefix=f".{directory.name}.", dir=directory.parent))  # mode 0700
            try:
                for stem in _FILES.values():
                    name = f"{stem}.{msp_id}"[:64]
                    root = build.build_root(name, msp_id, begin, begin + ROOT_VALIDITY, random_bytes)
                    write_atomic(building / f"{stem}.key", build.private_key_pem(root.key), PRIVATE)
                    write_atomic(building / f"{stem}.pem", root.certificate.public_bytes(Encoding.PEM), PUBLIC)
                write_atomic(building / "ca.json", json.dumps({"msp_id": msp_id}).encode() + b"\n", PRIVATE)
                create_register(building / "register.db")
                sync_directory(building)
                building.rename(directory)
                sync_directory(directory.parent)
            finally:
                shutil.rmtree(building, ignore_errors=True)
        except (FileExistsError, NotADirectoryError) as cause:
            raise CaExistsError(f"{directory} exists and is not empty") from cause
        except OSError as cause:
            if directory.is_dir() and any(directory.iterdir()):  # ENOTEMPTY
                raise CaExistsError(f"{directory} exists and is not empty") from cause
            raise CaStorageError(f"{directory}: {cause.strerror or cause}") from cause
        except FileWriteError as cause:
            raise CaStorageError(str(cause)) from cause
        return cls.open(directory, now=now, random_bytes=random_bytes)

    @classmethod
    def open(
        cls,
        directory: Path,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        random_bytes: RandomBytes = os.urandom,
    ) -> LocalCa:
        """Open an existing CA. Raises `CaNotFoundError`, `CaCorruptError`."""
        if not (directory / "ca.json").is_file():
            raise CaNotFoundError(f"{directory}: there is no certificate authority here")
        text = read_bounded(directory / "ca.json", CaCorruptError, "CA")
        try:
            msp_id = json.loads(text)["msp_id"]
        except (ValueError, KeyError, TypeError, RecursionError) as cause:
            raise CaCorruptError(f"{directory / 'ca.json'} does not say the msp_id") from cause
        if not isinstance(msp_id, str) or not _MSP_ID.fullmatch(msp_id):
            raise CaCorruptError(f"{directory / 'ca.json'}: {msp_id!r} is no MSP id")
        authorities = {kind: _load_authority(directory, stem) for kind, stem in _FILES.items()}
        if not (directory / "register.db").is_file():
            raise CaCorruptError(f"{directory / 'register.db'} is missing; restore it, or revocations are lost")
        return cls(directory, msp_id, authorities, now=now, random_bytes=random_bytes)

    def root_pem(self, kind: Kind = Kind.IDENTITY) -> bytes:
        """The root certificate of the identities, or of TLS."""
        return self._authorities[kind].certificate.public_bytes(Encoding.PEM)

    def enrol(
        self,
        name: str,
        *,
        node_ou: str = "client",
        attributes: Mapping[str, str] | None = None,
        kind: Kind = Kind.IDENTITY,
        hosts: Sequence[str] = (),
        validity: timedelta = VALIDITY,
        public_key: ec.EllipticCurvePublicKey | None = None,
    ) -> Enrolment:
        """Issue the first certificate of a name, or one after all of its former ones ended.

        Without `public_key` a fresh P-256 key is made. Raises `AlreadyEnrolledError`, `CaRequestError`, and what
        the register raises.
        """
        application = Application(name, node_ou, attributes or {}, kind, tuple(hosts), validity)
        application.check()
        with self._register(write=True) as register:
            active = self._active(register, name, kind)
            if active:
                raise AlreadyEnrolledError(
                    f"{name} already holds {kind} certificate {active[-1].serial}; renew it, or revoke it first"
                )
            return self._issue(register, application, public_key)

    def renew(
        self,
        name: str,
        *,
        kind: Kind = Kind.IDENTITY,
        attributes: Mapping[str, str] | None = None,
        hosts: Sequence[str] | None = None,
        validity: timedelta = VALIDITY,
        public_key: ec.EllipticCurvePublicKey | None = None,
        revoke_old: bool = False,
    ) -> Enrolment:
        """Issue a new certificate to a name that has, or had, one; OU, attributes and hosts are kept unless given.

        The old one stays good until it expires, so that a running agent can change over, unless `revoke_old`. A
        name whose last certificate was revoked is not renewed: that would undo the revocation; enrol it anew.
        Raises `UnknownCertificateError`, `CaRequestError`.
        """
        with self._register(write=True) as register:
            known = register.certificates(name, kind)
            if not known or known[-1].revoked_ms is not None:
                why = "its certificate was revoked" if known else "it was never enrolled"
                raise UnknownCertificateError(f"{name} has no {kind} certificate to renew: {why}; enrol it")
            last = known[-1]
            application = Application(
                name,
                last.node_ou,
                last.attributes if attributes is None else attributes,
                kind,
                last.hosts if hosts is None else tuple(hosts),
                validity,
            )
            application.check()
            old = self._active(register, name, kind)
            enrolment = self._issue(register, application, public_key)
            if revoke_old and old:
                self._revoke(register, old, kind, "superseded")
            return enrolment

    def revoke(
        self,
        *,
        name: str | None = None,
        serial: str | None = None,
        kind: Kind = Kind.IDENTITY,
        reason: str = "unspecified",
    ) -> tuple[IssuedCertificate, ...]:
        """Revoke all good certificates of a name, or the one with a serial number (hex); returns those revoked.

        The new revocation list is in the register when this returns. A ledger refuses them once the list is in its
        channel configuration. Raises `UnknownCertificateError`, `CaRequestError`.
        """
        if reason not in build.REASONS:
            raise CaRequestError(f"reason {reason!r} is none of {', '.join(build.REASONS)}")
        if (name is None) == (serial is None):
            raise CaRequestError("say either the name or the serial number of what is to be revoked")
        with self._register(write=True) as register:
            if serial is not None:
                found = register.by_serial(_plain_serial(serial))
                if found is None:
                    raise UnknownCertificateError(f"serial number {serial} was not issued by this CA")
                if found.revoked_ms is not None:
                    raise UnknownCertificateError(f"the certificate with serial number {serial} is revoked already")
                kind = found.kind
                targets: tuple[IssuedCertificate, ...] = (found,)
            else:
                targets = self._active(register, name, kind)
                if not targets:
                    raise UnknownCertificateError(f"{name} has no {kind} certificate that could be revoked")
            return self._revoke(register, targets, kind, reason)

    def certificates(self, name: str | None = None, kind: Kind | None = None) -> tuple[IssuedCertificate, ...]:
        """What was issued, oldest first, perhaps only to a name or of a kind."""
        with self._register(write=False) as register:
            return register.certificates(name, kind)

    def revocation_list_pem(self, kind: Kind = Kind.IDENTITY) -> bytes:
        """The current revocation list; a fresh one when less than half of its time is left."""
        now = self._time()
        with self._register(write=False) as register:
            current = register.revocation_list(kind)
        if current is None or moment(current.next_update_ms) - now < REVOCATION_LIST_VALIDITY / 2:
            with self._register(write=True) as register:
                current = self._new_revocation_list(register, kind, now)
        return current.pem

    def _register(self, *, write: bool) -> AbstractContextManager[Register]:
        return open_register(self.directory / "register.db", write=write)

    def _time(self) -> datetime:
        return self._now().replace(microsecond=0)

    def _active(self, register: Register, name: str | None, kind: Kind) -> tuple[IssuedCertificate, ...]:
        now_ms = milliseconds(self._time())
        return tuple(each for each in register.certificates(name, kind) if each.is_active(now_ms))

    def _issue(
        self, register: Register, application: Application, public_key: ec.EllipticCurvePublicKey | None
    ) -> Enrolment:
        authority = self._authorities[application.kind]
        begin = self._time()
        end = min(begin + application.validity, authority.certificate.not_valid_after_utc)
        if end <= begin:
            raise CaRequestError(f"the root certificate expired at {authority.certificate.not_valid_after_utc}")
        key = None
        if public_key is None:
            key = build.new_private_key(self._random_bytes)
            public_key = key.public_key()
        try:
            require_p256(public_key)
        except SignatureError as cause:
            raise CaRequestError(f"{application.name}: {cause}") from cause
        not_before = max(begin - BACKDATE, authority.certificate.not_valid_before_utc)
        terms = build.Terms(build.new_serial(self._random_bytes), not_before, end)
        certificate = build.build_certificate(authority, public_key, application, terms)
        issued = IssuedCertificate(
            serial=f"{terms.serial:x}",
            kind=application.kind,
            name=application.name,
            node_ou=application.node_ou,
            attributes=dict(application.attributes),
            hosts=application.hosts,
            not_before_ms=milliseconds(not_before),
            not_after_ms=milliseconds(end),
            pem=certificate.public_bytes(Encoding.PEM),
        )
        register.add(issued)
        return Enrolment(self.msp_id, issued, None if key is None else build.private_key_pem(key))

    def _revoke(
        self, register: Register, targets: Sequence[IssuedCertificate], kind: Kind, reason: str
    ) -> tuple[IssuedCertificate, ...]:
        now = self._time()
        for each in targets:
            register.revoke(each.serial, milliseconds(now), reason)
        self._new_revocation_list(register, kind, now)
        return tuple(replace(each, revoked_ms=milliseconds(now), reason=reason) for each in targets)

    def _new_revocation_list(self, register: Register, kind: Kind, now: datetime) -> RevocationList:
        former = register.revocation_list(kind)
        number = 1 if former is None else former.number + 1
        next_update = now + REVOCATION_LIST_VALIDITY
        # Expired certificates stay on the list: a third party may check a transaction of years ago.
        entries = [
            build.RevokedEntry(int(each.serial, 16), moment(each.revoked_ms or 0), each.reason)
            for each in register.revoked(kind)
        ]
        signed = build.build_revocation_list(self._authorities[kind], entries, number, now, next_update)
        current = RevocationList(number, milliseconds(next_update), signed.public_bytes(Encoding.PEM))
        register.set_revocation_list(kind, current)
        return current


def _load_authority(directory: Path, stem: str) -> build.Authority:
    pem = read_bounded(directory / f"{stem}.pem", CaCorruptError, "root certificate")
    key_pem = read_bounded(directory / f"{stem}.key", CaCorruptError, "root key")
    try:
        certificate = certificate_of(pem)
        key = load_pem_private_key(key_pem, None)
        public_key = certificate.public_key()
    except (ValueError, TypeError, UnsupportedAlgorithm) as cause:
        raise CaCorruptError(f"{directory}: {stem}.pem or {stem}.key is no PEM certificate or key") from cause
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != public_key:
        raise CaCorruptError(f"{directory}: {stem}.key is not the key of {stem}.pem")
    return build.Authority(certificate, key)


def _make_private_directory(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as cause:
        raise FileWriteError(f"{directory}: cannot be made ({cause.strerror or cause})") from cause


def _plain_serial(serial: str) -> str:
    plain = serial.lower().replace(":", "").removeprefix("0x").lstrip("0")
    if not _SERIAL.fullmatch(plain):
        raise CaRequestError(f"serial number {serial!r}: up to 40 hexadecimal digits")
    return plain
