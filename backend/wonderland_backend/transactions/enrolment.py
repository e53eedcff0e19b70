"""Getting a browser's key certified: by an organisation's CA, or, in a demo, at a click."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated

from wonderland.problems import said
from wonderland_backend.context import maybe
from wonderland_backend.errors import BadRequest, Forbidden, LedgerAway
from wonderland_backend.ledger.access import LedgerAccess
from wonderland_backend.transactions.functions import SIGNING_ROLES
from wonderland_fabric_gateway.ca import CertificateRequest
from wonderland_fabric_gateway.ca.client import FabricCaUnreachableError
from wonderland_fabric_gateway.ca.errors import CaError, CaRequestError
from wonderland_fabric_gateway.ca.invitations import Invited
from wonderland_fabric_gateway.errors import LedgerError

Registrar = Callable[[str, str], Awaitable[Invited]]
"""Invites a name to a role."""


@dataclass(frozen=True)
class DemoRegistrar:
    """Only a demo's backend has one; it is the right to make anybody of the organisations."""

    invite: Registrar


DemoRegistrarDep = Annotated[DemoRegistrar | None, maybe(DemoRegistrar)]


def read_request(pem: str) -> CertificateRequest:
    """The request of a browser. Raises `BadRequest`."""
    try:
        return CertificateRequest.parse(pem)
    except CaRequestError as error:
        raise BadRequest(said("bad_csr", why=error), ("body.request", str(error))) from None


async def enrol(ledger: LedgerAccess, msp_id: str, request: CertificateRequest, secret: str) -> bytes:
    """The certificate (PEM) for a name's one-time secret. Raises `Problem`."""
    try:
        return await ledger.enrol(msp_id, request, secret)
    except FabricCaUnreachableError as error:
        raise LedgerAway(said("ca_away", why=error)) from error
    except CaError as error:
        raise Forbidden(said("ca_refused", why=error)) from error
    except LedgerError as error:
        raise LedgerAway(said("ca_not_asked", why=error)) from error


async def enrol_in_demo(
    ledger: LedgerAccess, registrar: DemoRegistrar, role: str, request: CertificateRequest
) -> tuple[str, bytes]:
    """MSP id and certificate for a role of the demo. Raises `Problem`."""
    if role not in SIGNING_ROLES:
        raise BadRequest(said("demo_roles", roles=", ".join(sorted(SIGNING_ROLES))), ("body.role", said("unknown")))
    try:
        invited = await registrar.invite(request.name, role)
    except CaError as error:
        raise BadRequest(said("bad_csr", why=error), ("body.request", str(error))) from error
    return invited.msp_id, await enrol(ledger, invited.msp_id, request, invited.secret)
