"""Giving people, pads and drones an identity, with the CA of their organisation."""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Final

from cryptography.hazmat.primitives.serialization import Encoding

from wonderland_fabric_gateway.ca.errors import AlreadyEnrolledError, CaRequestError
from wonderland_fabric_gateway.ca.invitations import Invited
from wonderland_fabric_gateway.ca.requests import CertificateRequest
from wonderland_fabric_gateway.embedded.organisations import ROLES
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_network import certificates, connections
from wonderland_fabric_network.authorities import Certified
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.layout import CLIENT, MSP_ADMIN, REGISTRAR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland.enrolment.records import EnrolmentRequest
    from wonderland_fabric_network.authorities import Admitted
    from wonderland_fabric_network.network import Network

RESERVED: Final = frozenset({MSP_ADMIN, CLIENT, REGISTRAR, "contract"})


@dataclass(frozen=True)
class Request:
    """Who is to be enrolled. `msp_id` None: the first organisation whose kind has the role."""

    name: str
    role: str
    pol_id: str
    msp_id: str | None = None


@dataclass(frozen=True)
class Enrolled:
    """An identity that was enrolled, and where its files are."""

    name: str
    msp_id: str
    role: str
    pol_id: str
    serial: str
    valid_until: str
    certificate: str
    key: str

    def as_json(self) -> dict[str, str]:
        """JSON values, as `--json` prints them."""
        return asdict(self)


def home_of(network: Network, role: str, msp_id: str | None) -> str:
    """The organisation whose CA gives out a role. Raises `CaRequestError`."""
    kind = next((kind for kind, roles in connections.ROLES_OF_KIND.items() if role in roles), None)
    if kind is None:
        raise CaRequestError(f"role {role!r} is none of {', '.join(ROLES)}")
    homes = [each.msp_id for each in network.organisations if each.kind == kind]
    if msp_id is None and homes:
        return homes[0]
    if msp_id not in homes:
        raise CaRequestError(f"the role {role} is given by {' or '.join(homes) or 'nobody here'}, not by {msp_id}")
    return msp_id


async def enrol(network: Network, requests: Sequence[Request]) -> list[Enrolled]:
    """Enrol them, the organisations side by side. Raises `CaError`; those enrolled before an error stay so."""
    homes = [home_of(network, each.role, each.msp_id) for each in requests]
    for each, home in zip(requests, homes, strict=True):
        _require_free(network, each, home)
    async with AsyncExitStack() as stack:
        authorities = {home: await stack.enter_async_context(network.authority(home)) for home in dict.fromkeys(homes)}

        async def of(home: str) -> None:
            for each, its in zip(requests, homes, strict=True):
                if its == home:
                    who = Certified.with_role(each.name, each.role, each.pol_id)
                    await authorities[home].enrol(who, authorities[home].directory.identity(each.name))

        await together(of(home) for home in authorities)
    enrolled = []
    for each, home in zip(requests, homes, strict=True):
        connections.add(network, home, each.name)
        enrolled.append(_enrolled(network, each, home))
    return enrolled


async def invite(network: Network, request: Request) -> Invited:
    """Let a new name enrol itself, once, with a key that it makes. Raises `CaError`."""
    home = home_of(network, request.role, request.msp_id)
    _require_free(network, request, home)
    async with network.authority(home) as authority:
        secret = await authority.invite(Certified.with_role(request.name, request.role, request.pol_id))
    return Invited(request.name, home, request.role, secret)


async def admit(network: Network, asked: EnrolmentRequest, msp_id: str | None) -> Admitted:
    """Certificates for a machine's own keys; newer ones for a name that has that role. Raises `CaError`."""
    home = home_of(network, asked.role, msp_id)
    _require_not_ours(network, asked.name)
    who = Certified.with_role(asked.name, asked.role, asked.pol_id)
    async with network.authority(home) as authority:
        for issued in await authority.ca.certificates(await authority.registrar(), asked.name):
            has = Identity(home, issued.certificate.public_bytes(Encoding.PEM)).attributes
            if {name: has.get(name) for name in who.attributes} != who.attributes:
                raise AlreadyEnrolledError(
                    f"{asked.name} of {home} has certificates for another role or id. Next: have the machine ask under "
                    "another name"
                )
        return await authority.admit(
            who, CertificateRequest.parse(asked.request), CertificateRequest.parse(asked.tls_request)
        )


def _require_not_ours(network: Network, name: str) -> None:
    nodes = {member.name for member in (*network.peers, *network.orderers)}
    if name in RESERVED | nodes:
        raise CaRequestError(f"the name {name!r} belongs to the network itself; choose another one")


def _require_free(network: Network, request: Request, home: str) -> None:
    _require_not_ours(network, request.name)
    paths = network.directory.organisation(home).identity(request.name)
    if certificates.fits(paths) and certificates.load(paths.certificate).not_valid_after_utc > network.now():
        raise AlreadyEnrolledError(
            f"{request.name} of {home} has a certificate already ({paths.certificate}). Next: `network renew "
            f"{request.name}`, or `wonderland network revoke {request.name}`"
        )


def _enrolled(network: Network, request: Request, home: str) -> Enrolled:
    paths = network.directory.organisation(home).identity(request.name)
    certificate = certificates.load(paths.certificate)
    return Enrolled(
        request.name,
        home,
        request.role,
        request.pol_id,
        f"{certificate.serial_number:x}",
        f"{certificate.not_valid_after_utc:%Y-%m-%dT%H:%M:%SZ}",
        str(paths.certificate),
        str(paths.key),
    )
