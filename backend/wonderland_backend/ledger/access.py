"""The ledger itself, for what is more than reading its blocks: what people sign, and enrolling them."""

from __future__ import annotations

import json
from typing import Annotated, Final

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland.problems import said
from wonderland_backend.context import maybe, part_of
from wonderland_backend.errors import LedgerAway
from wonderland_evidence.export import export
from wonderland_evidence.stamping import with_timestamp
from wonderland_fabric_gateway.ca import CertificateRequest
from wonderland_fabric_gateway.ca.client import FabricCaClient
from wonderland_fabric_gateway.ca.errors import CaError, CaRequestError
from wonderland_fabric_gateway.connection import AuthorityAddress, Connection
from wonderland_fabric_gateway.embedded.system import LEDGER
from wonderland_fabric_gateway.errors import ConnectionFileError
from wonderland_fabric_gateway.files import read_bounded
from wonderland_fabric_gateway.gateway import CommitStatus, Contract, EvaluateError, Gateway, Proposal, Transaction
from wonderland_fabric_gateway.gateways import Gateways
from wonderland_fabric_gateway.identity import Identity

EMBEDDED: Final = "embedded"


class LedgerAccess:
    """One channel of the ledger, as this backend's own identity and on behalf of people who sign by themselves.

    The backend has no key of anybody's: what it proposes for people it cannot sign.
    """

    def __init__(self, connection: Connection, channel: Gateways, own: Gateway) -> None:
        self.channel: Final = connection.channel
        self.chaincode: Final = connection.chaincode
        self._connection = connection
        self._gateways = channel
        self._own = own.network(connection.channel)

    @property
    def is_embedded(self) -> bool:
        """Whether this is the embedded ledger, which enrols by itself."""
        return self._connection.ledger is not None and self._connection.ledger.kind == EMBEDDED

    def enrols(self, msp_ids: tuple[str, ...]) -> tuple[str, ...]:
        """Those of the organisations with whose CA somebody can enrol by this backend."""
        if self.is_embedded:
            return msp_ids
        return tuple(each for each in msp_ids if each in self._connection.authorities)

    def contract(self, identity: Identity) -> Contract:
        """The contract, proposed to as somebody who signs elsewhere."""
        return Gateway(self._gateways, identity, None).network(self.channel).contract(self.chaincode)

    def proposal(self, identity: Identity, data: bytes) -> Proposal:
        """A proposal of theirs from its bytes. Raises `GatewayError`."""
        return Gateway(self._gateways, identity, None).new_proposal(data)

    def transaction(self, identity: Identity, data: bytes) -> Transaction:
        """A transaction of theirs from its bytes. Raises `GatewayError`."""
        return Gateway(self._gateways, identity, None).new_transaction(data)

    async def evidence(self, session_id: str, timestamp_url: str | None = None) -> bytes:
        """A session's evidence (``wonderland-evidence/1``), read from the ledger alone. Raises `ExportError`.

        `timestamp_url`: a service (RFC 3161) to have it stamped by.
        """
        found = await export(self._own, self.chaincode, session_id)
        return (found if timestamp_url is None else await with_timestamp(found, timestamp_url)).encode()

    async def settle(self, transaction: Transaction) -> CommitStatus:
        """Submit a signed transaction until it has an outcome. Raises `GatewayError`."""
        return await self._own.settle(transaction)

    async def enrol(self, msp_id: str, request: CertificateRequest, secret: str) -> bytes:
        """A certificate (PEM) from an organisation's CA, for a name and its one-time secret. Raises `LedgerError`."""
        if self.is_embedded:
            argument = json.dumps({"msp_id": msp_id, "request": request.pem, "secret": secret})
            try:
                answer = json.loads(await self._own.contract(LEDGER).evaluate("Enrol", argument))
            except EvaluateError as cause:
                refused = cause.chaincode_response
                if refused is None:
                    raise
                raise CaError(refused.message) from cause
            return str(answer["certificate"]).encode()
        authority = self._connection.authorities.get(msp_id)
        if authority is None:
            raise CaRequestError(f"connection.json says no certificate authority of {msp_id[:80]}")
        return await _enrol(authority, request, secret)


async def _enrol(authority: AuthorityAddress, request: CertificateRequest, secret: str) -> bytes:
    root = read_bounded(authority.tls_ca, ConnectionFileError, "authorities: tls_ca")
    async with FabricCaClient(authority.address, authority.ca_name, root) as client:
        return await client.enrol_request(request, secret)


async def ledger_of(connection: HTTPConnection) -> LedgerAccess:
    """A dependency: the ledger for which is signed here. Raises `LedgerAway` where this backend has none."""
    found = part_of(connection, LedgerAccess)
    if found is None:
        raise LedgerAway(said("nothing_to_sign_with"))
    return found


LedgerDep = Annotated[LedgerAccess, Depends(ledger_of)]
MaybeLedgerDep = Annotated[LedgerAccess | None, maybe(LedgerAccess)]
"""For what asks it only once it knows for what."""
