"""connection.json: everything a client needs to reach a ledger, and the names of the identities it may act as.

    {"channel": "wonderland", "chaincode": "pol",
     "gateway": {"address": "host:port", "tls_ca": "tls-ca.pem", "server_name": "localhost"},
     "gateways": [{…}, …],
     "client_tls": {"certificate": "client-tls.pem", "key": "client-tls.key"},
     "authorities": {"PadMSP": {"address": "host:port", "ca_name": "ca-pad", "tls_ca": "pad-ca.pem",
                                "tls_ca_name": "tlsca-pad"}},
     "identities": {"pad": {"msp_id": "PadMSP", "certificate": "pad.pem", "key": "pad.key"}},
     "ledger": {"kind": "embedded", "notice": "…"}}

File names are relative to the file itself. `gateways` are further peers of the same organisation, for when `gateway`
does not answer; `client_tls` is what a client shows where peers demand certificates (mutual TLS); `authorities` are
the organisations' Fabric CAs. These and `ledger` are optional; further fields are left alone, so that a later version
may add some.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import grpc
from cryptography.hazmat.primitives.serialization import Encoding

from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.errors import ConnectionFileError, LedgerError
from wonderland_fabric_gateway.files import read_bounded, write_atomic
from wonderland_fabric_gateway.gateways import Gateways
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer, is_in_hardware, key_file_signer

if TYPE_CHECKING:
    from collections.abc import Mapping

FILE_NAME: Final = "connection.json"
MAX_IDENTITIES: Final = 10_000
MAX_GATEWAYS: Final = 20
MAX_AUTHORITIES: Final = 1_000
MAX_MESSAGE_BYTES: Final = 100 << 20
MAX_TEXT: Final = 4_096

CHANNEL_OPTIONS: Final[tuple[tuple[str, int], ...]] = (
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
    # A peer refuses pings more often than once a minute (keepalive.minInterval).
    ("grpc.keepalive_time_ms", 75_000),
    # Also TCP_USER_TIMEOUT: mobile networks forget connections and tell nobody. What was sent and is not acknowledged
    # for so long ends the connection; a new one costs two round trips, and streams go on where they were.
    ("grpc.keepalive_timeout_ms", 5_000),
    # An attempt to connect, 20 s by default, of which TCP's own repeats are 1, 3, 7 and 15 s after the first packet.
    ("grpc.min_reconnect_backoff_ms", 5_000),
    ("grpc.http2.max_pings_without_data", 0),
    # With the default of 1 s growing to 120 s a stream waits long for a ledger that is back already.
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 5_000),
)
"""What a gRPC channel to a Gateway needs beyond the defaults; see `Connection.open_channel`."""


@dataclass(frozen=True, slots=True)
class GatewayAddress:
    """Where the Gateway listens: `address` is ``host:port``, `server_name` the name its TLS certificate must carry."""

    address: str
    tls_ca: Path
    server_name: str


@dataclass(frozen=True, slots=True)
class ClientTls:
    """What a client shows on a TLS connection: certificate file and private key file, both PEM.

    Every method raises `ConnectionFileError`.
    """

    certificate: Path
    key: Path

    def certificate_pem(self) -> bytes:
        """The client's certificate, read from its file. Raises `LedgerError`."""
        return read_bounded(self.certificate, ConnectionFileError, "client_tls.certificate")

    def key_pem(self) -> bytes:
        """The client's private key, read from its file. Raises `LedgerError`."""
        return read_bounded(self.key, ConnectionFileError, "client_tls.key")

    def sha256(self) -> bytes:
        """SHA-256 over the DER certificate, which requests for blocks name."""
        try:
            certificate = certificate_of(self.certificate_pem())
        except ValueError as cause:
            raise ConnectionFileError(
                f"client_tls.certificate: {self.certificate} holds no PEM certificate ({cause})"
            ) from cause
        return hashlib.sha256(certificate.public_bytes(Encoding.DER)).digest()


@dataclass(frozen=True, slots=True)
class IdentityFiles:
    """An identity that this connection may act as: MSP id, certificate file and private key file, both PEM."""

    msp_id: str
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True)
class LedgerKind:
    """What kind of ledger this is (embedded or fabric), and a notice to show people, "" for none."""

    kind: str
    notice: str


@dataclass(frozen=True, slots=True)
class AuthorityAddress:
    """An organisation's Fabric CA: ``host:port``, the CA's name on that server, the root of its TLS certificate.

    `tls_ca_name` is the CA of TLS certificates on the same server; "" where that is not known.
    """

    address: str
    ca_name: str
    tls_ca: Path
    tls_ca_name: str = ""


@dataclass(frozen=True)
class Connection:
    """A parsed connection.json. Paths are absolute."""

    channel: str
    chaincode: str
    gateway: GatewayAddress
    identities: Mapping[str, IdentityFiles] = field(default_factory=lambda: MappingProxyType({}))
    ledger: LedgerKind | None = None
    others: tuple[GatewayAddress, ...] = ()
    """Further peers of the same organisation (`gateways` in the file), in the order of preference."""
    client_tls: ClientTls | None = None
    authorities: Mapping[str, AuthorityAddress] = field(default_factory=lambda: MappingProxyType({}))
    """Where organisations' Fabric CAs are, by MSP id: for people who enrol with a secret of theirs."""

    @classmethod
    def load(cls, path: Path) -> Connection:
        """Read connection.json, or the one in a directory. Raises `ConnectionFileError`, which names the field."""
        if path.is_dir():
            path /= FILE_NAME
        data = read_bounded(path, ConnectionFileError, "connection file", limit=8 << 20)
        try:
            document = json.loads(data.decode())
        except (ValueError, RecursionError) as cause:
            raise ConnectionFileError(f"{path}: no JSON ({cause})") from cause
        return _Reader(path).connection(document)

    def save(self, path: Path) -> None:
        """Write connection.json, atomically, with file names relative to it. Raises `FileWriteError`."""
        directory = path.parent.resolve()

        def name(file: Path) -> str:
            return os.path.relpath(file.resolve(), directory)

        def gateway(each: GatewayAddress) -> dict[str, str]:
            return {"address": each.address, "tls_ca": name(each.tls_ca), "server_name": each.server_name}

        document: dict[str, object] = {
            "channel": self.channel,
            "chaincode": self.chaincode,
            "gateway": gateway(self.gateway),
            "identities": {
                who: {"msp_id": files.msp_id, "certificate": name(files.certificate), "key": name(files.key)}
                for who, files in sorted(self.identities.items())
            },
        }
        if self.others:
            document["gateways"] = [gateway(each) for each in self.others]
        if self.client_tls is not None:
            document["client_tls"] = {
                "certificate": name(self.client_tls.certificate),
                "key": name(self.client_tls.key),
            }
        if self.authorities:
            document["authorities"] = {
                msp_id: {"address": each.address, "ca_name": each.ca_name, "tls_ca": name(each.tls_ca)}
                | ({"tls_ca_name": each.tls_ca_name} if each.tls_ca_name else {})
                for msp_id, each in sorted(self.authorities.items())
            }
        if self.ledger is not None:
            document["ledger"] = {"kind": self.ledger.kind, "notice": self.ledger.notice}
        write_atomic(path, json.dumps(document, indent=2, ensure_ascii=False).encode() + b"\n")

    def with_identity(self, name: str, files: IdentityFiles) -> Connection:
        """The same connection with one more identity, or that one replaced."""
        return replace(self, identities=MappingProxyType({**self.identities, name: files}))

    def without_identity(self, name: str) -> Connection:
        """The same connection without that identity."""
        left = {each: files for each, files in self.identities.items() if each != name}
        return replace(self, identities=MappingProxyType(left))

    def identity(self, name: str) -> Identity:
        """The named identity, its certificate read now. Raises `ConnectionFileError`."""
        files = self.files(name)
        try:
            return Identity.from_file(files.msp_id, files.certificate)
        except LedgerError as cause:
            raise ConnectionFileError(f"identities.{name}.certificate: {cause}") from cause

    def signer(self, name: str) -> Signer:
        """A signer with the named identity's key file. Raises `ConnectionFileError`."""
        files = self.files(name)
        try:
            return key_file_signer(files.key)
        except LedgerError as cause:
            raise ConnectionFileError(f"identities.{name}.key: {cause}") from cause

    def client_files(self, name: str) -> ClientTls | None:
        """What the named identity can show other servers that demand a certificate: `client_tls`, or its own.

        None where its key is in hardware, which TLS cannot use here. Raises `ConnectionFileError`.
        """
        if self.client_tls is not None:
            return self.client_tls
        files = self.files(name)
        if is_in_hardware(read_bounded(files.key, ConnectionFileError, f"identities.{name}.key")):
            return None
        return ClientTls(files.certificate, files.key)

    def open_channel(self, *options: tuple[str, int | str]) -> Gateways:
        """TLS channels to the Gateways; the caller closes them. `options` override ours. Raises `ConnectionFileError`.

        Each connects when first used, and again by itself after its Gateway was away. Call it inside a running event
        loop.
        """
        key, certificate, digest = None, None, b""
        if self.client_tls is not None:
            certificate, key = self.client_tls.certificate_pem(), self.client_tls.key_pem()
            digest = self.client_tls.sha256()
        channels = []
        for each, field_name in [(self.gateway, "gateway"), *((other, "gateways") for other in self.others)]:
            roots = read_bounded(each.tls_ca, ConnectionFileError, f"{field_name}.tls_ca")
            ours: dict[str, int | str] = dict(CHANNEL_OPTIONS)
            ours["grpc.ssl_target_name_override"] = each.server_name
            ours.update(options)
            credentials = grpc.ssl_channel_credentials(roots, key, certificate)
            channels.append(
                (each.address, grpc.aio.secure_channel(each.address, credentials, options=list(ours.items())))
            )
        return Gateways(channels, tls_certificate_sha256=digest)

    def files(self, name: str) -> IdentityFiles:
        """The named identity's files. Raises `ConnectionFileError`."""
        try:
            return self.identities[name]
        except KeyError:
            known = ", ".join(sorted(self.identities)[:20]) or "none"
            raise ConnectionFileError(f"identities.{name}: there is no such identity; there are: {known}") from None


class _Reader:
    """Turns the JSON document into a Connection; every complaint names the file and the field."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._directory = path.resolve().parent

    def connection(self, document: object) -> Connection:
        top = self._object(document, "the file")
        identities = self._object(top.get("identities", {}), "identities")
        if len(identities) > MAX_IDENTITIES:
            raise self._wrong("identities", f"has {len(identities)} entries; at most {MAX_IDENTITIES}")
        return Connection(
            channel=self._text(top, "channel"),
            chaincode=self._text(top, "chaincode"),
            gateway=self._gateway(top.get("gateway"), "gateway"),
            identities=MappingProxyType({name: self._identity(name, each) for name, each in identities.items()}),
            ledger=self._ledger(top["ledger"]) if "ledger" in top else None,
            others=self._others(top.get("gateways", [])),
            client_tls=self._client_tls(top["client_tls"]) if "client_tls" in top else None,
            authorities=self._authorities(top.get("authorities", {})),
        )

    def _gateway(self, value: object, name: str) -> GatewayAddress:
        fields = self._object(value, name)
        return GatewayAddress(
            address=self._address(self._text(fields, "address", f"{name}."), f"{name}.address"),
            tls_ca=self._file(fields, "tls_ca", f"{name}."),
            server_name=self._text(fields, "server_name", f"{name}."),
        )

    def _others(self, value: object) -> tuple[GatewayAddress, ...]:
        if not isinstance(value, list) or len(value) > MAX_GATEWAYS:
            raise self._wrong("gateways", f"is not a list of at most {MAX_GATEWAYS} gateways")
        return tuple(self._gateway(each, f"gateways[{index}]") for index, each in enumerate(value))

    def _client_tls(self, value: object) -> ClientTls:
        fields = self._object(value, "client_tls")
        return ClientTls(self._file(fields, "certificate", "client_tls."), self._file(fields, "key", "client_tls."))

    def _authorities(self, value: object) -> Mapping[str, AuthorityAddress]:
        entries = self._object(value, "authorities")
        if len(entries) > MAX_AUTHORITIES:
            raise self._wrong("authorities", f"has {len(entries)} entries; at most {MAX_AUTHORITIES}")
        return MappingProxyType({msp_id: self._authority(msp_id, each) for msp_id, each in entries.items()})

    def _authority(self, msp_id: str, value: object) -> AuthorityAddress:
        prefix = f"authorities.{msp_id}"
        fields = self._object(value, prefix)
        return AuthorityAddress(
            address=self._address(self._text(fields, "address", f"{prefix}."), f"{prefix}.address"),
            ca_name=self._text(fields, "ca_name", f"{prefix}."),
            tls_ca=self._file(fields, "tls_ca", f"{prefix}."),
            tls_ca_name=self._text(fields, "tls_ca_name", f"{prefix}.") if "tls_ca_name" in fields else "",
        )

    def _identity(self, name: str, value: object) -> IdentityFiles:
        prefix = f"identities.{name}"
        fields = self._object(value, prefix)
        return IdentityFiles(
            msp_id=self._text(fields, "msp_id", f"{prefix}."),
            certificate=self._file(fields, "certificate", f"{prefix}."),
            key=self._file(fields, "key", f"{prefix}."),
        )

    def _ledger(self, value: object) -> LedgerKind:
        fields = self._object(value, "ledger")
        notice = fields.get("notice", "")
        if not isinstance(notice, str):
            raise self._wrong("ledger.notice", "is not text")
        return LedgerKind(kind=self._text(fields, "kind", "ledger."), notice=notice)

    def _address(self, address: str, name: str) -> str:
        host, separator, port = address.rpartition(":")
        if not (separator and host and port.isascii() and port.isdigit() and len(port) <= 5 and 0 < int(port) < 65_536):
            raise self._wrong(name, f"is {address!r}, not host:port")
        return address

    def _file(self, fields: dict[str, object], name: str, prefix: str) -> Path:
        text = self._text(fields, name, prefix)
        if "\0" in text:
            raise self._wrong(prefix + name, "holds a NUL character")
        return self._directory / text

    def _object(self, value: object, name: str) -> dict[str, object]:
        if not isinstance(value, dict):
            raise self._wrong(name, "is missing" if value is None else "is not a JSON object")
        return value

    def _text(self, fields: dict[str, object], name: str, prefix: str = "") -> str:
        value = fields.get(name)
        if not isinstance(value, str) or not value:
            raise self._wrong(prefix + name, "is missing" if value is None else "is not a non-empty text")
        if len(value) > MAX_TEXT:
            raise self._wrong(prefix + name, f"has {len(value)} characters; at most {MAX_TEXT}")
        return value

    def _wrong(self, name: str, why: str) -> ConnectionFileError:
        return ConnectionFileError(f"{self._path}: {name} {why}")
