"""What a machine asks for, and what it is given. Pure."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Annotated, Final, TypeVar

from wonderland.proofs.errors import ProofError, RecordError
from wonderland.proofs.records.schema import Choice, Described, Integer, Items, Record, Text
from wonderland.proofs.records.transactions import ROLES
from wonderland_fabric_gateway.ca.errors import CaRequestError
from wonderland_fabric_gateway.ca.requests import CertificateRequest
from wonderland_fabric_gateway.certificates import certificate_of
from wonderland_fabric_gateway.errors import LedgerError

MAX_BYTES: Final = 1 << 20
NAME: Final = r"[A-Za-z0-9][A-Za-z0-9._-]*"
_ADDRESS: Final = r"[A-Za-z0-9\[][A-Za-z0-9.:\[\]-]*:[0-9]{1,5}"
_Record = TypeVar("_Record", bound=Record)
_Pem = Annotated[str, Text(16_000, r"[A-Za-z0-9+/=\n -]*", "PEM", 1)]
_Request = Annotated[str, Text(8_192, r"[A-Za-z0-9+/=\n -]*", "A certificate request (PKCS#10), PEM", 1)]
_Address = Annotated[str, Text(300, _ADDRESS, "host:port")]
_Sha256 = Annotated[str, Text(64, r"[0-9a-f]{64}", "SHA-256, lower-case hexadecimal")]


class EnrolmentError(LedgerError):
    """A request or an admission that cannot be used; the text says why, and what to do."""


@dataclass(frozen=True, kw_only=True)
class EnrolmentRequest(Record):
    """What a machine asks of its organisation. Nothing in it is secret."""

    RECORD = "EnrolmentRequest"
    name: Annotated[str, Text(64, NAME, "Its name at the CA, good once", 1)]
    role: Annotated[str, Choice(ROLES, "What it would do")]
    pol_id: Annotated[str, Text(64, r"[^\x00-\x1f\x7f]*", "Its id in the registry", 1)]
    request: _Request
    tls_request: _Request
    t_s: Annotated[int, Integer(0, 1 << 40, "When it was made: seconds since 1970")]

    @classmethod
    def read(cls, data: bytes, source: str) -> EnrolmentRequest:
        """A request of a file. Raises `EnrolmentError`."""
        return _read(cls, data, source, "request for a certificate")

    def validate(self, path: str) -> None:
        """Each is signed by the key that it names, and made for that name."""
        prefix = f"{path}." if path else ""
        keys = []
        for field, pem in (("request", self.request), ("tls_request", self.tls_request)):
            try:
                found = CertificateRequest.parse(pem)
            except CaRequestError as cause:
                raise RecordError(f"{prefix}{field}", str(cause)) from cause
            if found.name != self.name:
                raise RecordError(f"{prefix}{field}", f"is for {found.name[:80]!r}, not for {self.name!r}")
            keys.append(found.public_key)
        if keys[0] == keys[1]:
            raise RecordError(f"{prefix}tls_request", "has the identity's key; TLS needs one of its own")

    @property
    def sha256(self) -> str:
        """Over its canonical bytes, lower-case hex."""
        return hashlib.sha256(self.encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Gateway(Record):
    """A peer by which the ledger is reached."""

    address: _Address
    server_name: Annotated[str, Text(253, r"[A-Za-z0-9.:-]*", "The name that its TLS certificate carries", 1)]


@dataclass(frozen=True, kw_only=True)
class AuthorityPlace(Record):
    """The organisation's Fabric CA, where certificates are renewed."""

    address: _Address
    ca_name: Annotated[str, Text(100, NAME, "Of identities", 1)]
    tls_ca_name: Annotated[str, Text(100, NAME, "Of TLS certificates", 1)]
    root: _Pem


@dataclass(frozen=True, kw_only=True)
class Admission(Record):
    """What a machine is given: its certificates, and how it reaches the ledger. Nothing in it is secret."""

    RECORD = "EnrolmentAdmission"
    request_sha256: _Sha256
    msp_id: Annotated[str, Text(63, r"[A-Za-z][A-Za-z0-9.-]*", "Whose it is", 1)]
    certificate: _Pem
    tls_certificate: _Pem | None = None
    channel: Annotated[str, Text(249, r"[a-z][a-z0-9.-]*", "The channel's name", 1)]
    chaincode: Annotated[str, Text(64, NAME, "The contract's name", 1)]
    gateways: Annotated[tuple[Gateway, ...], Items(1, 20, "Peers, the first one first")]
    tls_root: _Pem
    authority: Annotated[AuthorityPlace | None, Described("Where it renews")] = None
    ledger_kind: Annotated[str, Text(40, r"[a-z]+", "What kind of ledger it is")] = "fabric"
    notice: Annotated[str, Text(500, description="For people")] = ""

    @classmethod
    def read(cls, data: bytes, source: str) -> Admission:
        """An admission of a file. Raises `EnrolmentError`."""
        return _read(cls, data, source, "admission of a machine")

    @property
    def sha256(self) -> str:
        """Over its canonical bytes, lower-case hex."""
        return hashlib.sha256(self.encode()).hexdigest()

    def require_answers(self, request: EnrolmentRequest) -> None:
        """Raise `EnrolmentError` unless its certificates are for the keys that the request was made with."""
        if self.request_sha256 != request.sha256:
            raise EnrolmentError(
                f"the admission answers another request than {request.name}'s of here ({code(request.sha256)}). Next: "
                "give that one to who admits, and take its answer"
            )
        pairs = [(self.certificate, request.request), (self.tls_certificate, request.tls_request)]
        for pem, asked in pairs:
            if pem is None:
                continue
            try:
                key = certificate_of(pem.encode()).public_key()
            except ValueError as cause:
                raise EnrolmentError(f"the admission has no certificate that can be read ({cause})") from cause
            if key != CertificateRequest.parse(asked).public_key:
                raise EnrolmentError("the admission has a certificate for another key than the one of here")


def code(sha256: str) -> str:
    """What people compare: the first 80 bits."""
    return "-".join(sha256[i : i + 4] for i in range(0, 20, 4)).upper()


def _read(kind: type[_Record], data: bytes, source: str, what: str) -> _Record:
    try:
        return kind.decode(data, max_bytes=MAX_BYTES)
    except ProofError as cause:
        raise EnrolmentError(f"{source}: no {what} ({cause})") from cause
