"""The chain's heads, kept on the ledger: whoever could rewrite the database could not rewrite these."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Annotated, Final, Protocol

from fastapi import Depends
from starlette.requests import HTTPConnection

from wonderland.proof_contract import Committed
from wonderland.proofs.records.audit import MAX_HEADS, AnchorAuditLog, AuditHead, AuditHeadsOf
from wonderland_backend.audit import queries
from wonderland_backend.audit.store import record
from wonderland_backend.context import ContextDep, part_of
from wonderland_backend.db.engine import Database
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.identity import Identity
from wonderland_fabric_gateway.signing import Signer

logger = logging.getLogger(__name__)

SERVER: Final = "the server"
ANCHORED: Final = "audit_anchored"


class Heads(Protocol):
    """What is needed of the contract; `ProofContract` has it."""

    async def anchor_audit_log(self, argument: AnchorAuditLog) -> tuple[AuditHead, Committed]:
        """Write down where a log stands. Raises `LedgerError`."""

    async def audit_heads(self, argument: AuditHeadsOf) -> tuple[AuditHead, ...]:
        """Heads of a log, oldest first. Raises `LedgerError`."""


class Anchors:
    """The heads of one installation's log. `anchored_by` is the common name under which they stand."""

    def __init__(self, contract: Heads, anchored_by: str, instance: str) -> None:
        self._contract = contract
        self.anchored_by: Final = anchored_by
        self.instance: Final = instance

    async def put(self, seq: int, sha256: str) -> AuditHead:
        """Write a head to the ledger. Raises `LedgerError`."""
        head, _ = await self._contract.anchor_audit_log(AnchorAuditLog(log=self.instance, seq=seq, sha256=sha256))
        return head

    async def all(self) -> list[AuditHead]:
        """Every head of this identity, whichever log it was of, oldest first. Raises `LedgerError`."""
        found: list[AuditHead] = []
        while True:
            more = await self._contract.audit_heads(AuditHeadsOf(anchored_by=self.anchored_by, after=len(found)))
            found += more
            if len(more) < MAX_HEADS:
                return found


class AuditIdentity:
    """The contract as the identity that anchors the audit log."""

    def __init__(self, contract: Heads, identity: Identity, signer: Signer) -> None:
        self._contract = contract
        self.identity: Final = identity
        self.signer: Final = signer

    def anchors(self, instance: str) -> Anchors:
        """Those of an installation's log."""
        return Anchors(self._contract, self.identity.common_name, instance)


async def anchors_of(connection: HTTPConnection, context: ContextDep) -> Anchors | None:
    """A dependency: None where no identity of this backend may anchor the log."""
    identity = part_of(connection, AuditIdentity)
    return None if identity is None else identity.anchors(context.instance)


AnchorsDep = Annotated[Anchors | None, Depends(anchors_of)]


class Anchoring:
    """Writes the head to the ledger when there is something new."""

    def __init__(self, database: Database, anchors: Anchors, *, every_s: int, clock: Callable[[], int]) -> None:
        self._database = database
        self._anchors = anchors
        self._every_s = every_s
        self._clock = clock

    async def run(self) -> None:
        """Anchor the log's head again and again, until cancelled."""
        while True:
            await asyncio.sleep(self._every_s)
            try:
                await self.anchor()
            except LedgerError as error:
                logger.warning("the audit log could not be anchored on the ledger; trying again: %s", error)
            except Exception:
                logger.exception("the audit log could not be anchored; trying again")

    async def anchor(self) -> bool:
        """Write the head, unless the last row only says that this was done. Raises `LedgerError`."""
        async with self._database.read() as session:
            head = await queries.head(session)
        if head is None or head.act == ANCHORED:
            return False
        done = await self._anchors.put(head.seq, head.sha256)
        detail = {"sha256": head.sha256}
        async with self._database.write() as connection:
            subject = f"audit/{head.seq}"
            await record(connection, SERVER, ANCHORED, subject, detail, done.tx_id, t_ms=self._clock())
        return True


async def instance_of(database: Database) -> str:
    """The installation whose log it is; empty for a server that has never started."""
    async with database.read() as session:
        return await queries.instance(session) or ""
