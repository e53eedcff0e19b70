"""What an embedded ledger keeps on disk, and how a first start fills it.

    connection.json   what every client takes; written when the ledger serves
    tls-ca.pem        the root of the ledger's TLS certificate
    identities/       certificate and key of each enrolled identity (keys 0600)
    ca/<MSP id>/      each organisation's certificate authority
    node/             the ledger's own identities: peers, orderer, administrators, TLS; seal.key
    ledger.sqlite3    the chain and its state
    ledger.lock       held by the one process that runs the ledger

Every step can be interrupted at any point and is completed by the next start.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import fcntl
import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cryptography.hazmat.primitives.serialization import load_pem_private_key

from wonderland_fabric_gateway.attributes import ID, ROLE
from wonderland_fabric_gateway.ca import AlreadyEnrolledError, CaNotFoundError, Invitations, Kind, LocalCa
from wonderland_fabric_gateway.ca.application import VALIDITY
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.connection import FILE_NAME, Connection, IdentityFiles
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.config_update import ConfigSigners, SigningIdentity
from wonderland_fabric_gateway.embedded.errors import DirectoryError, LedgerLockedError
from wonderland_fabric_gateway.embedded.seal import KEY_BYTES
from wonderland_fabric_gateway.embedded.server import TlsFiles
from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import key_file_signer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

_MSP_ID: Final = re.compile(r"[A-Za-z][A-Za-z0-9.-]{0,62}")
NODE_VALIDITY: Final = dt.timedelta(days=5 * 365)
RENEW_BEFORE: Final = dt.timedelta(days=30)
_PEER: Final = "peer"
_ORDERER: Final = "orderer"
_ADMINISTRATOR: Final = "msp-admin"
_TLS: Final = "ledger"
NODE_NAMES: Final = frozenset({_PEER, _ORDERER, _ADMINISTRATOR, _TLS})
"""Names that belong to the ledger itself; nobody is enrolled under them."""


@dataclass(frozen=True)
class NodeIdentities:
    """The ledger's own identities."""

    peers: tuple[SigningIdentity, ...]
    signers: ConfigSigners


class LedgerDirectory:
    """The files of one ledger. `now` gives the time (aware UTC)."""

    def __init__(self, path: Path, now: Callable[[], dt.datetime] = lambda: dt.datetime.now(dt.UTC)) -> None:
        self.path: Final = path
        self.database: Final = path / "ledger.sqlite3"
        self.connection_file: Final = path / FILE_NAME
        self.tls_root: Final = path / "tls-ca.pem"
        self._node = path / "node"
        self._seal_key = self._node / "seal.key"
        self._now = now

    def prepare(self) -> None:
        """Make the directory, private to its owner. Raises `DirectoryError`."""
        try:
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._node.mkdir(exist_ok=True, mode=0o700)
            if not os.access(self.path, os.W_OK):
                raise DirectoryError(f"{self.path} cannot be written by this user")
        except OSError as cause:
            raise DirectoryError(f"{self.path} cannot be used as a ledger's directory ({cause.strerror})") from cause

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the directory for one ledger process. Raises `LedgerLockedError` when another one has it."""
        with self._locked("ledger.lock", blocking=False):
            yield

    def running_pid(self) -> int | None:
        """The process id of the ledger that runs here, or None; 0 when it does not say."""
        try:
            handle = os.open(self.path / "ledger.lock", os.O_RDWR)
        except OSError:
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            text = os.read(handle, 32).strip()
            return int(text) if text.isdigit() else 0
        else:
            return None
        finally:
            os.close(handle)

    def ca(self, msp_id: str) -> LocalCa:
        """An organisation's CA. Raises `CaNotFoundError` before the first start, or what `LocalCa` raises."""
        return LocalCa.open(self.path / "ca" / msp_id, now=self._now)

    def invitations(self, msp_id: str) -> Invitations:
        """The invitations of an organisation's CA. Raises as `ca`."""
        return Invitations(self.ca(msp_id), now=self._now)

    @property
    def pad_operators(self) -> tuple[str, ...]:
        """The operators of pads besides `organisations.PAD`, as the first start made them."""
        with contextlib.suppress(OSError):
            # What an interrupted start left half made there has a name with a dot before it.
            names = {each.name for each in (self.path / "ca").iterdir() if _MSP_ID.fullmatch(each.name)}
            return tuple(sorted(names - set(orgs.ALL)))
        return ()

    @property
    def organisations(self) -> tuple[str, ...]:
        """All organisations' MSP ids."""
        return (*orgs.ALL, *self.pad_operators)

    def ensure_cas(self, pad_operators: Sequence[str] = ()) -> dict[str, LocalCa]:
        """All organisations' CAs, made where they are missing; and the TLS root for clients.

        Raises `DirectoryError` for a name that cannot be an organisation's, or that comes after the first start.
        """
        for msp_id in pad_operators:
            if not _MSP_ID.fullmatch(msp_id) or msp_id in orgs.ALL:
                raise DirectoryError(
                    f"{msp_id[:80]!r} cannot be the name of another operator of pads: a letter, then letters, digits, "
                    f". and -, 63 at most, and none of {', '.join(orgs.ALL)}"
                )
            if self.database.exists() and msp_id not in self.pad_operators:
                raise DirectoryError(
                    f"the ledger in {self.path} was made without {msp_id}; its organisations stay as its first start "
                    "made them. Start without it, or in another directory"
                )
        cas: dict[str, LocalCa] = {}
        for msp_id in dict.fromkeys((*self.organisations, *pad_operators)):
            try:
                cas[msp_id] = self.ca(msp_id)
            except CaNotFoundError:
                cas[msp_id] = LocalCa.create(self.path / "ca" / msp_id, msp_id, now=self._now)
        root = cas[orgs.AUTHORITY].root_pem(Kind.TLS)
        if not self.tls_root.exists() or self.tls_root.read_bytes() != root:
            write_atomic(self.tls_root, root, PUBLIC)
        return cas

    def ensure_node(self, cas: Mapping[str, LocalCa]) -> NodeIdentities:
        """Peers, orderer and administrators, enrolled or renewed where needed."""

        def own(name: str, msp_id: str, unit: str) -> SigningIdentity:
            stem = f"{name}-{msp_id}"
            self._ensure(cas[msp_id], name, stem, node_ou=unit)
            certificate, key = self._node / f"{stem}.pem", self._node / f"{stem}.key"
            return SigningIdentity(Identity.from_file(msp_id, certificate), key_file_signer(key))

        endorsing = [msp_id for each in orgs.endorsing(self.pad_operators) for msp_id in each]
        peers = tuple(own(_PEER, msp_id, "peer") for msp_id in endorsing)
        admins = {msp_id: own(_ADMINISTRATOR, msp_id, "admin") for msp_id in self.organisations}
        orderer = own(_ORDERER, orgs.ORDERER, "orderer")
        return NodeIdentities(peers, ConfigSigners(admins, orderer))

    def seal_key(self) -> bytes:
        """The secret that the ledger seals its rows with; empty where none is kept yet. Raises `DirectoryError`."""
        if not self._seal_key.exists():
            return b""
        key = read_bounded(self._seal_key, DirectoryError, "the ledger's seal", KEY_BYTES)
        if len(key) != KEY_BYTES:
            raise DirectoryError(f"{self._seal_key} is not whole; restore the ledger's directory from a copy")
        return key

    def keep_seal_key(self, key: bytes) -> None:
        """Keep the secret; only once the ledger is sealed with it. Raises `FileWriteError`."""
        write_atomic(self._seal_key, key)

    def ensure_tls(self, ca: LocalCa, hosts: Sequence[str]) -> TlsFiles:
        """The server's certificate for these host names and addresses, issued anew when it lacks one of them."""
        self._ensure(ca, _TLS, "tls", kind=Kind.TLS, node_ou="peer", hosts=tuple(dict.fromkeys(hosts)))
        return TlsFiles((self._node / "tls.pem").read_bytes(), (self._node / "tls.key").read_bytes())

    def ensure_roles(self, cas: Mapping[str, LocalCa]) -> dict[str, IdentityFiles]:
        """One identity per role, for a first start."""
        found: dict[str, IdentityFiles] = {}
        wanted = {name: (role.msp_id, role) for name, role in orgs.ROLES.items()}
        for msp_id in self.pad_operators:
            wanted |= {f"{name}@{msp_id}": (msp_id, orgs.ROLES[name]) for name in orgs.PAD_ROLES}
        for name, (msp_id, role) in wanted.items():
            attributes = {ROLE: role.name, ID: role.pol_id}
            certificate, key = self.identity_files(name)
            if not (certificate.exists() and key.exists()):
                self._issue(cas[msp_id], name, certificate.parent, name, attributes=attributes)
            found[name] = IdentityFiles(msp_id, certificate, key)
        return found

    def identity_files(self, name: str) -> tuple[Path, Path]:
        """Where certificate and key of an enrolled identity are."""
        return self.path / "identities" / f"{name}.pem", self.path / "identities" / f"{name}.key"

    def administrator(self, msp_id: str) -> SigningIdentity:
        """An organisation's administrator (OU admin). Raises `IdentityError`, `SignatureError`."""
        stem = f"{_ADMINISTRATOR}-{msp_id}"
        return SigningIdentity(
            Identity.from_file(msp_id, self._node / f"{stem}.pem"), key_file_signer(self._node / f"{stem}.key")
        )

    def update_connection(self, change: Callable[[Connection | None], Connection]) -> Connection:
        """Read connection.json (None if there is none), change it, write it; one process at a time.

        Raises `ConnectionFileError`, `FileWriteError`.
        """
        with self._locked("connection.lock", blocking=True):
            current = Connection.load(self.connection_file) if self.connection_file.exists() else None
            changed = change(current)
            if changed != current:
                changed.save(self.connection_file)
        return changed

    def _ensure(
        self,
        ca: LocalCa,
        name: str,
        stem: str,
        *,
        node_ou: str,
        kind: Kind = Kind.IDENTITY,
        hosts: tuple[str, ...] = (),
    ) -> None:
        """Files in ``node/`` with a certificate that is this CA's, whole, good for a while, and for all `hosts`."""
        certificate, key = self._node / f"{stem}.pem", self._node / f"{stem}.key"
        if certificate.exists() and key.exists() and _fits(certificate.read_bytes(), key.read_bytes()):
            pem = certificate.read_bytes()
            horizon_ms = int((self._now() + RENEW_BEFORE).timestamp() * 1000)
            for issued in ca.certificates(name, kind):
                good = issued.revoked_ms is None and issued.not_after_ms > horizon_ms
                if good and issued.pem == pem and set(hosts) <= set(issued.hosts):
                    return
        self._issue(ca, name, self._node, stem, node_ou=node_ou, kind=kind, hosts=hosts, validity=NODE_VALIDITY)

    @staticmethod
    def _issue(
        ca: LocalCa,
        name: str,
        directory: Path,
        stem: str,
        *,
        node_ou: str = "client",
        attributes: Mapping[str, str] | None = None,
        kind: Kind = Kind.IDENTITY,
        hosts: tuple[str, ...] = (),
        validity: dt.timedelta = VALIDITY,
    ) -> None:
        try:
            enrolment = ca.enrol(
                name, node_ou=node_ou, attributes=attributes, kind=kind, hosts=hosts, validity=validity
            )
        except AlreadyEnrolledError:
            # Enrolled by a start that was interrupted before it wrote the files, or about to expire.
            enrolment = ca.renew(name, kind=kind, attributes=attributes, hosts=hosts, validity=validity)
        enrolment.write(directory, stem)

    @contextlib.contextmanager
    def _locked(self, name: str, *, blocking: bool) -> Iterator[None]:
        path = self.path / name
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as cause:
            raise DirectoryError(f"{path}: {cause.strerror}") from cause
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | (0 if blocking else fcntl.LOCK_NB))
            except BlockingIOError as cause:
                pid = os.read(handle, 32).decode(errors="replace").strip()
                raise LedgerLockedError(
                    f"a ledger already runs in {self.path}{f' (process {pid})' if pid else ''}; "
                    "stop it, or use another directory"
                ) from cause
            os.truncate(handle, 0)
            os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
            yield
        finally:
            os.close(handle)


def _fits(certificate_pem: bytes, key_pem: bytes) -> bool:
    """Whether a key belongs to a certificate; not after a write that was interrupted between the two."""
    try:
        certificate = certificate_of(certificate_pem)
        return load_pem_private_key(key_pem, None).public_key() == certificate.public_key()
    except (ValueError, TypeError):
        return False
