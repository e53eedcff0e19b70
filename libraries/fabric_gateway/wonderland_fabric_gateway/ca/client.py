"""A client of Fabric CA's REST interface: enrol, renew, register, revoke, and fetch the revocation list.

Sources: fabric-ca, ``swagger/swagger-fabric-ca.json`` and ``lib/`` (tokens: ``util/util.go``). Private keys are made
here and never leave; the server sees certificate requests only. Needs the extra ``network``.
"""

from __future__ import annotations

import base64
import binascii
import datetime as dt
import ipaddress
import json
import ssl
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any, Final, Self

import httpx
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from wonderland_fabric_gateway.ca.application import is_address
from wonderland_fabric_gateway.ca.errors import CaError
from wonderland_fabric_gateway.certificates import certificate_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wonderland_fabric_gateway.ca.requests import CertificateRequest
    from wonderland_fabric_gateway.identity import SigningIdentity

TIMEOUT_S: Final = 20.0
MAX_ANSWER_BYTES: Final = 8 << 20
ALREADY_REGISTERED: Final = 74
NO_SUCH_IDENTITY: Final = 63
AUTHENTICATION_FAILED: Final = 20
_HINTS: Final = {
    AUTHENTICATION_FAILED: "the name, the secret or the certificate is not (or no longer) one that this CA accepts",
    71: "the registrar may not do this",
    ALREADY_REGISTERED: "this name is registered already",
}


class FabricCaError(CaError):
    """The CA answered, and refused. `code` is Fabric CA's own number, 0 when it gave none."""

    def __init__(self, text: str, *, status: int, code: int = 0) -> None:
        super().__init__(text)
        self.status = status
        self.code = code


class FabricCaUnreachableError(CaError):
    """The CA did not answer in time, or not as itself (its TLS certificate)."""


class FabricCaAnswerError(CaError):
    """What answered is no Fabric CA, or it answered with something else than was asked for."""


@dataclass(frozen=True)
class CaInfo:
    """What a CA says of itself. `chain_pem` ends in its root; `now` is its time (aware), None when it says none."""

    name: str
    chain_pem: bytes
    version: str
    now: dt.datetime | None = None


@dataclass(frozen=True)
class IssuedByFabricCa:
    """A certificate that a CA knows of."""

    certificate: x509.Certificate
    pem: bytes


@dataclass(frozen=True)
class Revoked:
    """A certificate that was revoked: serial number and authority key identifier, lower-case hex."""

    serial: str
    authority_key_id: str


class FabricCaClient:
    """One CA of a Fabric CA server. Use as an asynchronous context.

    `address` is ``host:port``; `tls_root_pem` the root that the server's TLS certificate must come from; `transport`
    replaces the network.
    """

    def __init__(
        self,
        address: str,
        ca_name: str,
        tls_root_pem: bytes,
        *,
        timeout_s: float = TIMEOUT_S,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self.address: Final = address
        self.ca_name: Final = ca_name
        self._said_at: dt.datetime | None = None
        try:
            context = ssl.create_default_context(cadata=tls_root_pem.decode("ascii"))
        except (ssl.SSLError, UnicodeDecodeError) as cause:
            raise FabricCaUnreachableError(f"CA {address}: the TLS root is no PEM certificate ({cause})") from cause
        self._http = httpx.AsyncClient(
            base_url=f"https://{address}", verify=context, trust_env=False, timeout=timeout_s, transport=transport
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._http.aclose()

    async def info(self) -> CaInfo:
        """The CA's name, chain, version and time. Raises `CaError`."""
        result = await self._call("POST", "/api/v1/cainfo", {})
        return CaInfo(
            _text(result, "CAName"), _base64(result, "CAChain"), str(result.get("Version", "")), self._said_at
        )

    async def enrol(
        self,
        name: str,
        secret: str,
        key: ec.EllipticCurvePrivateKey,
        *,
        profile: str = "",
        hosts: Sequence[str] = (),
    ) -> bytes:
        """A certificate (PEM) for a registered name. Raises `CaError`."""
        result = await self._call("POST", "/api/v1/enroll", _enrolment(name, key, profile, hosts), basic=(name, secret))
        return self._certificate(result, name, key.public_key())

    async def enrol_request(self, request: CertificateRequest, secret: str, *, profile: str = "") -> bytes:
        """A certificate (PEM) for a registered name, by a request that its owner made elsewhere. Raises `CaError`."""
        body = {"certificate_request": request.pem, "profile": profile, "hosts": []}
        result = await self._call("POST", "/api/v1/enroll", body, basic=(request.name, secret))
        return self._certificate(result, request.name, request.public_key)

    async def reenrol(self, current: SigningIdentity, request: CertificateRequest, *, profile: str = "") -> bytes:
        """A new certificate (PEM) in place of one that still holds; its key may go on. Raises `CaError`."""
        body = {"certificate_request": request.pem, "profile": profile, "hosts": []}
        result = await self._call("POST", "/api/v1/reenroll", body, who=current)
        return self._certificate(result, request.name, request.public_key)

    async def register(
        self,
        registrar: SigningIdentity,
        name: str,
        *,
        node_ou: str,
        secret: str,
        attributes: Mapping[str, str] | None = None,
        max_enrolments: int = -1,
    ) -> None:
        """Make a name known, so that it can be enrolled. Raises `FabricCaError` (code 74: it is known already)."""
        body = {
            "id": name,
            "type": node_ou,
            "affiliation": "",
            "secret": secret,
            "max_enrollments": max_enrolments,
            "attrs": _attributes(attributes),
        }
        await self._call("POST", "/api/v1/register", body, who=registrar)

    async def set_secret(
        self,
        registrar: SigningIdentity,
        name: str,
        secret: str,
        *,
        attributes: Mapping[str, str] | None = None,
    ) -> None:
        """Give a known name a new secret, and perhaps other attributes. Raises `CaError`."""
        body: dict[str, Any] = {"secret": secret}
        if attributes:
            body["attrs"] = _attributes(attributes)
        await self._call("PUT", f"/api/v1/identities/{name}", body, who=registrar)

    async def revoke(
        self,
        registrar: SigningIdentity,
        *,
        name: str = "",
        certificate: x509.Certificate | None = None,
        reason: str = "unspecified",
    ) -> tuple[Revoked, ...]:
        """Revoke all certificates of a name, which can then never enrol again, or one certificate. Raises `CaError`."""
        body: dict[str, Any] = {"reason": reason.lower()}
        if certificate is not None:
            body["serial"] = f"{certificate.serial_number:x}"
            body["aki"] = authority_key_id(certificate)
        else:
            body["id"] = name
        result = await self._call("POST", "/api/v1/revoke", body, who=registrar)
        entries = result.get("RevokedCerts") or []
        if not isinstance(entries, list):
            raise FabricCaAnswerError(f"CA {self.address}: RevokedCerts is no list")
        return tuple(Revoked(_text(entry, "Serial").lower(), _text(entry, "AKI").lower()) for entry in entries)

    async def revocation_list(self, registrar: SigningIdentity) -> bytes:
        """The list of revoked certificates that have not expired, PEM. Raises `CaError`."""
        return _base64(await self._call("POST", "/api/v1/gencrl", {}, who=registrar), "CRL")

    async def certificates(self, registrar: SigningIdentity, name: str = "") -> tuple[IssuedByFabricCa, ...]:
        """Certificates that this CA issued, perhaps only to a name. Raises `CaError`."""
        path = f"/api/v1/certificates?ca={self.ca_name}" + (f"&id={name}" if name else "")
        result = await self._call("GET", path, None, who=registrar)
        entries = result.get("certs") or []
        if not isinstance(entries, list):
            raise FabricCaAnswerError(f"CA {self.address}: certs is no list")
        return tuple(self._listed(entry) for entry in entries)

    async def _call(
        self,
        method: str,
        path: str,
        body: dict[str, Any] | None,
        *,
        who: SigningIdentity | None = None,
        basic: tuple[str, str] | None = None,
    ) -> dict[str, Any]:
        content = b"" if body is None else json.dumps({**body, "caname": self.ca_name}).encode()
        headers = {"content-type": "application/json"}
        if who is not None:
            headers["authorization"] = token(who, method, path, content)
        request = self._http.build_request(method, path, content=content, headers=headers)
        try:
            response = await self._http.send(request, auth=basic, stream=True)
            try:
                answer = await _bounded(response)
                self._said_at = _http_date(response.headers.get("date", ""))
            finally:
                await response.aclose()
        except httpx.HTTPError as cause:
            why = str(cause) or type(cause).__name__
            raise FabricCaUnreachableError(f"CA {self.address}: no answer ({why}); does it run?") from cause
        return self._result(response.status_code, answer)

    def _result(self, status: int, answer: bytes) -> dict[str, Any]:
        try:
            document = json.loads(answer)
        except (ValueError, RecursionError) as cause:
            raise FabricCaAnswerError(
                f"CA {self.address}: answered {status} without JSON; is it a Fabric CA?"
            ) from cause
        if not isinstance(document, dict):
            raise FabricCaAnswerError(f"CA {self.address}: answered {status} with no JSON object")
        result = document.get("result")
        if document.get("success") is True and isinstance(result, dict):
            return result
        errors = document.get("errors")
        first = errors[0] if isinstance(errors, list) and errors and isinstance(errors[0], dict) else {}
        number = first.get("code")
        code = number if isinstance(number, int) else 0
        text = str(first.get("message", "no explanation"))[:500]
        hint = _HINTS.get(code, "")
        raise FabricCaError(
            f"CA {self.ca_name} at {self.address} refused ({status}, code {code}): {text}{f'; {hint}' if hint else ''}",
            status=status,
            code=code,
        )

    def _certificate(self, result: dict[str, Any], name: str, key: ec.EllipticCurvePublicKey) -> bytes:
        pem = _base64(result, "Cert")
        try:
            certificate = certificate_of(pem)
            ours = certificate.public_key() == key
        except ValueError as cause:
            raise FabricCaAnswerError(
                f"CA {self.address}: its certificate for {name} cannot be read ({cause})"
            ) from cause
        names = [each.value for each in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
        if not ours or names != [name]:
            raise FabricCaAnswerError(f"CA {self.address}: its certificate is for {names}, not for {name} and its key")
        return pem

    def _listed(self, entry: object) -> IssuedByFabricCa:
        pem = _text(entry, "PEM").encode()
        try:
            return IssuedByFabricCa(certificate_of(pem), pem)
        except ValueError as cause:
            raise FabricCaAnswerError(
                f"CA {self.address}: lists a certificate that cannot be read ({cause})"
            ) from cause


def token(who: SigningIdentity, method: str, uri: str, body: bytes) -> str:
    """The authorization header: base64(certificate) "." base64(signature over method, URI, body and certificate)."""
    certificate = _encode(who.identity.certificate_pem)
    message = f"{method}.{_encode(uri.encode())}.{_encode(body)}.{certificate}".encode()
    return f"{certificate}.{_encode(who.sign(message))}"


def authority_key_id(certificate: x509.Certificate) -> str:
    """The authority key identifier, lower-case hex. Raises `FabricCaAnswerError` where there is none."""
    try:
        found = certificate.extensions.get_extension_for_class(x509.AuthorityKeyIdentifier).value.key_identifier
    except (x509.ExtensionNotFound, ValueError) as cause:
        raise FabricCaAnswerError("the certificate names no authority key identifier") from cause
    return (found or b"").hex()


def _enrolment(name: str, key: ec.EllipticCurvePrivateKey, profile: str, hosts: Sequence[str]) -> dict[str, Any]:
    builder = x509.CertificateSigningRequestBuilder().subject_name(
        x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])  # Fabric CA insists: CN is the enrolment id
    )
    if hosts:
        names = [x509.IPAddress(ipaddress.ip_address(h)) if is_address(h) else x509.DNSName(h) for h in hosts]
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    request = builder.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM).decode()
    return {"certificate_request": request, "profile": profile, "hosts": list(hosts)}


def _attributes(attributes: Mapping[str, str] | None) -> list[dict[str, Any]]:
    return [{"name": name, "value": value, "ecert": True} for name, value in (attributes or {}).items()]


def _http_date(text: str) -> dt.datetime | None:
    try:
        moment = parsedate_to_datetime(text)
    except ValueError:
        return None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=dt.UTC)


async def _bounded(response: httpx.Response) -> bytes:
    parts: list[bytes] = []
    size = 0
    async for part in response.aiter_bytes():
        size += len(part)
        if size > MAX_ANSWER_BYTES:
            raise FabricCaAnswerError(f"the CA's answer is larger than {MAX_ANSWER_BYTES} bytes")
        parts.append(part)
    return b"".join(parts)


def _text(result: object, name: str) -> str:
    value = result.get(name) if isinstance(result, dict) else None
    if not isinstance(value, str) or not value:
        raise FabricCaAnswerError(f"the CA's answer lacks the text {name!r}")
    return value


def _base64(result: dict[str, Any], name: str) -> bytes:
    try:
        return base64.b64decode(_text(result, name), validate=True)
    except (binascii.Error, ValueError) as cause:
        raise FabricCaAnswerError(f"the CA's answer: {name} is no base64") from cause


def _encode(data: bytes) -> str:
    return base64.b64encode(data).decode()


__all__ = [
    "ALREADY_REGISTERED",
    "CaInfo",
    "FabricCaAnswerError",
    "FabricCaClient",
    "FabricCaError",
    "FabricCaUnreachableError",
    "IssuedByFabricCa",
    "Revoked",
    "authority_key_id",
    "token",
]
